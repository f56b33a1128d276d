"""Nodes as processes: started, watched, ended; and the watch over a drive."""

import io
import subprocess
import sys
import time
from contextlib import nullcontext
from pathlib import Path

import pytest
from nav_msgs.msg import Odometry
from tqdm import tqdm

from sphere_nav_tools.cli import processes as processes_module
from sphere_nav_tools.cli.demo import watch as module
from sphere_nav_tools.cli.demo.watch import WatchedDrive
from sphere_nav_tools.cli.processes import Processes, python_command
from worlds.patience import Patience


def odometry(x: float) -> Odometry:
    message = Odometry()
    message.pose.pose.position.x = x
    return message


@pytest.mark.parametrize(("speed", "is_told"), [(0.0, True), (1.0, False)])
def test_a_drive_whose_car_stands_for_long_fails_and_says_who_is_silent(tmp_path, domain, monkeypatch, speed, is_told):
    seconds, bars = iter(range(1, 100)), []
    monkeypatch.setattr(module, "SILENCE", 0.3)
    monkeypatch.setattr(module, "tqdm", lambda **_: bars.append(tqdm(total=20, file=io.StringIO())) or bars[0])
    stands = "drive: the car has not moved for 0 s; localiser silent, follower silent"

    with WatchedDrive(tmp_path, domain) as watch:

        def drive() -> bool:
            now = next(seconds)
            watch.link._on_odometry(odometry(speed * now))
            return now == 30

        monkeypatch.setattr(module, "LOOK_S", 0.02)
        with pytest.raises(RuntimeError, match=stands) if is_told else nullcontext():
            watch.wait("drive", drive, 20.0)
    assert bars[0].n == (0 if is_told else 20)


@pytest.mark.dds
def test_a_node_that_cannot_start_is_told_by_its_last_words(tmp_path, domain):
    with Processes(tmp_path, domain) as processes:
        processes.start("bag_recorder", {"output": ""})  # it needs an output
        patience = Patience(60.0)
        with pytest.raises(RuntimeError, match=r"bag_recorder ended with status 2: .*output"):  # noqa: PT012
            while patience.is_left():
                processes.check()
                time.sleep(0.1)


def test_a_process_that_ignores_ctrl_c_is_killed(tmp_path, monkeypatch):
    monkeypatch.setattr(processes_module, "END_PATIENCE_S", 0.2)
    deaf = "import signal, time; signal.signal(signal.SIGINT, signal.SIG_IGN); print(1, flush=True); time.sleep(20)"
    patience = Patience(60.0)
    with Processes(tmp_path) as processes:
        processes.begin("deaf", python_command(deaf))
        while not processes.last_words("deaf") and patience.is_left():
            time.sleep(0.05)
        assert processes.stop("deaf") == -9


PARENT = """
import os, sys, time
from pathlib import Path
from sphere_nav_tools.cli.processes import Processes, python_command
with Processes(Path(sys.argv[1]), int(os.environ["ROS_DOMAIN_ID"])) as processes:
    code = "import os, time; print(os.getpid(), flush=True); time.sleep(60)"
    processes.begin("sleeper", python_command(code))
    time.sleep(60)
"""


@pytest.mark.dds
def test_children_end_with_a_parent_that_is_killed(tmp_path):
    parent = subprocess.Popen([sys.executable, "-c", PARENT, str(tmp_path)])
    log, patience = tmp_path / "sleeper.log", Patience(60.0)
    while not (log.is_file() and log.read_text().endswith("\n")) and patience.is_left():
        time.sleep(0.05)
    child = Path(f"/proc/{log.read_text().strip()}")
    assert child.is_dir()
    parent.kill()
    parent.wait()
    while child.is_dir() and patience.is_left():
        time.sleep(0.05)
    assert not child.is_dir()
