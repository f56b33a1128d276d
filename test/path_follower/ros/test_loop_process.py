"""Real processes: a loop that gets the signals, and a front that may be busy, or killed."""

import itertools
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

import rclpy
from rclpy.qos import QoSProfile
from std_msgs.msg import Bool

from benchmarks.fault_busy import big_path, front_of
from benchmarks.fault_processes import CRUISE, Base
from path_follower.ros.loop_process import PRIORITY
from sphere_nav.ros import qos
from worlds.patience import Patience

# a process of its own: whoever publishes waits for the front, and the base must go on telling where it is
SEND = """
import signal, sys
import rclpy
from nav_msgs.msg import Path
from sphere_nav.ros import qos

rclpy.init()
publisher = rclpy.create_node("sender").create_publisher(Path, "reference_path", qos.LATCHED)
print("ready", flush=True)
publisher.publish(sys.stdin.buffer.read())
signal.pause()
"""


def process(module, *arguments):
    code = f"import sys; from {module} import main; sys.exit(main())"
    return subprocess.Popen([sys.executable, "-c", code, "--ros-args", *arguments])


@pytest.fixture
def follower(tmp_path):
    (tmp_path / "path.csv").write_text("\n".join(f"{x},0" for x in range(400)))
    late = [f"safety.{name}:=5.0" for name in ("max_pose_silence", "max_blind_time", "max_status_silence")]
    words = [f"trajectory:={tmp_path / 'path.csv'}", *late]  # poses come from the test, which a busy machine may delay
    child = process("path_follower.ros.node", *(part for word in words for part in ("-p", word)))
    yield child
    child.kill()
    child.wait()


@pytest.fixture
def base():
    rclpy.init()
    base = Base()
    yield base
    for node in (base.node, *base.others):
        node.destroy_node()
    rclpy.try_shutdown()


@pytest.fixture
def sender():
    """Return a process that publishes what it reads."""
    with subprocess.Popen([sys.executable, "-c", SEND], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        assert child.stdout.readline() == b"ready\n"
        yield child
        child.kill()


def is_running(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().split()[2] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.dds
def test_a_front_that_is_busy_holds_up_neither_commands_nor_the_stop(follower, base, sender):
    """2,000,000 bytes of path cost the front seconds; a signal to it would, too."""
    base.drive_off()
    os.kill(front_of(follower.pid), signal.SIGSTOP)  # as busy as can be
    base.commands.clear()
    sender.stdin.write(big_path(20_000))
    sender.stdin.close()
    base.live(1.0)
    times = [when for when, _ in base.commands]
    assert max(b - a for a, b in itertools.pairwise(times)) < 0.5  # 0.1 s on an idle machine
    assert base.speed > 0.9 * CRUISE, base.reason
    base.is_pressed = True
    assert base.live(120.0, lambda: base.speed == 0.0)
    assert base.live(120.0, lambda: base.reason == "EMERGENCY_STOP")
    follower.send_signal(signal.SIGINT)
    assert follower.wait(120.0) == 0


@pytest.mark.dds
def test_a_front_that_is_killed_leaves_zero_and_ends_the_process(follower, base):
    base.drive_off()
    os.kill(front_of(follower.pid), signal.SIGKILL)
    assert base.live(120.0, lambda: base.speed == 0.0)
    assert follower.wait(120.0) == 1


def policies(pid):
    return {os.sched_getscheduler(int(thread)) for thread in os.listdir(f"/proc/{pid}/task")}


def may_be_real_time():
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except PermissionError:
        return False
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    return True


@pytest.mark.dds
def test_every_thread_of_the_loop_and_none_of_its_front_is_real_time_where_it_may_be(follower, base):
    base.drive_off()
    assert policies(follower.pid) == {os.SCHED_FIFO if may_be_real_time() else os.SCHED_OTHER}
    assert policies(front_of(follower.pid)) == {os.SCHED_OTHER}


@pytest.mark.dds
def test_a_loop_that_is_killed_takes_its_front_along(follower, base):
    base.drive_off()
    front = front_of(follower.pid)
    follower.kill()
    follower.wait()
    patience = Patience(20.0)
    while is_running(front) and patience.is_left():
        time.sleep(0.05)
    assert not is_running(front)


@pytest.mark.dds
@pytest.mark.parametrize(
    ("profile", "is_heard"), [(qos.SENSOR, False), (qos.LATCHED, True), (QoSProfile(depth=1), False)]
)
def test_an_emergency_stop_of_any_qos_is_heard_or_named(tmp_path, base, follower, profile, is_heard):
    """Published before the follower is there: what was latched is heard, anything else refuses the start by name."""
    base.node.destroy_publisher(base.button)
    base.button = base.node.create_publisher(Bool, "emergency_stop", profile)
    base.button.publish(Bool(data=True))
    silent = type("Silent", (), {"publish": lambda self, message: None})()
    button, base.button = base.button, silent
    wanted = "EMERGENCY_STOP: release" if is_heard else "base publishes emergency_stop, but nothing of it was heard"
    answers = []

    def is_refused():
        if base.start.service_is_ready() and all(answer.done() for answer in answers):
            answers.append(base.start.call_async(base.request))
        return any(answer.done() and wanted in answer.result().message for answer in answers)

    assert base.live(120.0, is_refused)
    base.button = button
    base.is_pressed = False
    base.drive_off()
    base.is_pressed = True
    assert base.live(120.0, lambda: base.speed == 0.0)
