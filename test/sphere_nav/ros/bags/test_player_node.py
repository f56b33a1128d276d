"""Recorder and player as processes over real DDS: what is played is what is recorded."""

import errno
import os
import shlex
import signal
import sys
import time
from contextlib import closing

import numpy as np
import pytest
from rclpy.duration import Duration
from rclpy.parameter import Parameter
from sensor_msgs.msg import Image
from std_msgs.msg import Header, String

from sphere_nav.ros import qos
from sphere_nav.ros.bags import BagError, BagReader, BagWriter, verify_bag
from sphere_nav.ros.bags.recorder_node import BagRecorder
from sphere_nav.ros.conversions import array_to_image
from sphere_nav.ros.live import LiveShell
from sphere_nav.ros.node import WARN
from sphere_nav_tools.cli.main import main
from sphere_nav_tools.cli.processes import node_command
from worlds.desk import Desk

PATIENCE = 40.0  # s; a process starts in half a second, on a busy machine in ten
START, STEP = 7_000_000_000, 50_000_000


@pytest.fixture
def start(spawn):
    def begin(node, *more, **values):
        words = [word for name, value in values.items() for word in ("-p", f"{name}:={value}")] + list(more)
        return spawn(node_command(node, "--ros-args", *words))

    return begin


def end_of(process):
    _, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, err
    assert "Traceback" not in err
    return err


def line_with(process, text):
    """Read the log of a process up to a line."""
    for line in process.stderr:
        if text in line:
            return line
    raise AssertionError(f"expected a line with {text!r}")


@pytest.fixture
def drive(tmp_path):
    """Thirty images of 1.5 MB, more than Fast DDS has shared memory for by default, and what else a drive has."""
    pixels = np.random.default_rng(1).integers(0, 255, (800, 640, 3), np.uint8)
    with BagWriter(tmp_path / "drive", is_compressed=False) as bag:
        bag.add_topic("latched", String, qos.LATCHED)
        bag.write("latched", String(data="once"), START)
        bag.add_topic("image_raw", Image, qos.LARGE)
        for number in range(30):
            stamp = START + number * STEP
            bag.write("stamp", Header(frame_id=str(number)), stamp)
            pixels[0, 0] = number
            bag.write("image_raw", array_to_image(pixels, stamp, "camera", "rgb8"), stamp)
    return tmp_path / "drive"


@pytest.mark.dds
def test_what_is_played_is_recorded(start, drive, tmp_path):
    out = tmp_path / "recorded"
    recorder = start("bag_recorder", output=out, topics="'/image_raw /stamp /latched /never'", compressed="false")
    line_with(recorder, "recording into")
    player = start("bag_player", bag=drive, rate=0.0, wait_for="'/image_raw /stamp /latched'")
    assert "60 messages played" in end_of(player)
    recorder.send_signal(signal.SIGINT)
    err = end_of(recorder)
    assert "nothing came on /never" in err
    with BagReader(drive) as before, BagReader(out) as after:
        assert verify_bag(after) == (61, [])
        counts = {name: info.count for name, info in after.topics.items()}
        assert counts == {"/image_raw": 30, "/stamp": 30, "/latched": 1}
        assert after.topics["/latched"].profile.durability == qos.TRANSIENT_LOCAL
        for topic in before.topics:
            pairs = zip(before.messages([topic]), after.messages([topic]), strict=True)
            assert all(first.message == second.message for first, second in pairs)


@pytest.mark.dds
def test_in_a_namespace_all_that_was_recorded_goes_below_it(start, drive, ros):
    stamps, beside = [], []
    with closing(Desk()) as desk:
        desk.peer.create_subscription(Header, "/car2/stamp", lambda m: stamps.append(m.frame_id), 50)
        desk.peer.create_subscription(Header, "/stamp", lambda m: beside.append(m.frame_id), 50)
        player = start("bag_player", "-r", "__ns:=/car2", bag=drive, topics="/stamp", rate=0.0, wait_for="/stamp")
        desk.until(lambda: len(stamps) == 30)
        end_of(player)
    assert beside == []


def test_a_full_disk_ends_the_recording_with_one_line(recorder, tmp_path, monkeypatch):
    shell, ended = recorder(tmp_path / "out"), []
    shell.finish = ended.append

    def fail():
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(shell.node.bag, "flush", fail)
    monkeypatch.setattr(shell.node.bag, "close", fail)
    shell.node._attempt(shell.node.bag.flush)
    assert ended == [1]
    shell.stop()
    assert not (tmp_path / "out").exists()


RECORDER = """
import os, sys, time
from sphere_nav.ros.bags import recorder_node
sync, seconds, recorder_node.BagRecorder.PATIENCE = os.fsync, float(sys.argv.pop(1)), float(sys.argv.pop(1))
os.fsync = lambda number: (time.sleep(seconds), sync(number))
sys.exit(recorder_node.main())
"""


@pytest.mark.dds
def test_what_is_not_complete_in_time_is_told_with_the_command_that_rescues_it(spawn, tmp_path):
    """On a disk that takes a minute to sync, within two seconds."""
    command = [sys.executable, "-c", RECORDER, "60.0", "2.0", "--ros-args"]
    process = spawn([*command, "-p", f"output:={tmp_path / 'slow'}", "-p", "topic_set:=all"])
    line_with(process, "ready: ")  # something was recorded
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=PATIENCE)
    (line,) = [line for line in err.splitlines() if "not complete" in line]
    assert process.returncode == 1
    assert line.startswith("no end 2 s after the signal: ")
    words = shlex.split(line.split("'")[1])
    assert words == ["sphere_nav", "verify-bag", f"{tmp_path / 'slow'}.partial", "--salvage", f"{tmp_path / 'slow'}"]
    assert main(words[1:]) == 0
    with BagReader(tmp_path / "slow") as bag:
        assert verify_bag(bag)[1] == []


@pytest.fixture
def recorder(ros):
    shells = []

    def begin(output):
        values = {"output": str(output), "topics": "/text"}
        overrides = [Parameter(name, value=value) for name, value in values.items()]
        shells.append(LiveShell(BagRecorder, parameter_overrides=overrides))
        assert shells[-1].start()
        return shells[-1]

    yield begin
    for shell in shells:
        shell.stop()
        shell.destroy_node()


def test_a_second_recorder_takes_the_next_name_and_the_first_one_goes_on(recorder, drive):
    nodes = [recorder(drive).node for _ in range(2)]
    assert [node.bag.path.name for node in nodes] == ["drive_2", "drive_3"]
    partial = nodes[0].bag.partial
    with pytest.raises(BagError, match=r"drive_2.partial: a run that is still writing, or the remains of one: '"):
        BagWriter(drive.with_name("drive_2"))
    for node in nodes:
        assert node.unfinished().endswith("keeps what is whole")
        node.endpoints.stop()
        assert node.unfinished() == ""
    assert not partial.exists()
    with BagReader(drive) as bag:
        assert verify_bag(bag)[1] == []


@pytest.mark.dds
def test_what_waits_at_the_end_is_recorded(recorder, tmp_path):
    shell = recorder(tmp_path / "late")
    publisher = shell.create_publisher(String, "/text", 30)
    shell.node._look()
    ends = time.monotonic() + PATIENCE
    while not publisher.get_subscription_count() and time.monotonic() < ends:
        time.sleep(0.01)
    for number in range(30):
        publisher.publish(String(data=str(number)))
    assert publisher.wait_for_all_acked(Duration(seconds=PATIENCE))
    shell.stop()
    shell.destroy_publisher(publisher)
    with BagReader(tmp_path / "late") as bag:
        assert [item.message.data for item in bag.messages(["/text"])] == [str(number) for number in range(30)]


def test_what_is_lost_is_told_by_topic(recorder, tmp_path):
    node, lines = (shell := recorder(tmp_path / "lossy")).node, []
    publisher = shell.create_publisher(String, "/text", 10)
    node._look()
    shell.log.warning = lambda line, **options: lines.append(line)
    wanted = node.recorded["/text"]
    for number in (1, 2, 5, 6, 9):  # 3, 4, 7 and 8 never arrive
        wanted.count(number, 1)
        wanted.deliver(b"")
    node._look()
    loss = "/text: 4 of 9 messages lost (44.4%)"
    line = f"1 topics; {loss}"
    assert (node.reports["recording"][:2], lines) == ((WARN, line), [line])
    shell.destroy_publisher(publisher)
    shell.stop()
    assert lines[1:] == [loss]
