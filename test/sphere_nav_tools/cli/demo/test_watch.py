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
from sphere_nav_tools.cli.demo.watch import DriveFailed, DriveMonitor
from sphere_nav_tools.cli.processes import Processes
from worlds.patience import Patience


def truth(seconds: int, x: float) -> Odometry:
    message = Odometry()
    message.header.stamp.sec, message.pose.pose.position.x = seconds, x
    return message


def test_a_drive_in_which_nothing_happens_fails_and_says_who_is_silent(tmp_path, monkeypatch, domain):
    monkeypatch.setattr(module, "SILENCE", 0.5)
    silent = "drive: nothing for 0 s; localiser silent, follower silent"
    with (
        Processes(tmp_path, domain) as processes,
        DriveMonitor(processes, domain) as watch,
        pytest.raises(DriveFailed, match=silent),
    ):
        watch.wait("drive", lambda: False, is_moving=True)


@pytest.mark.parametrize(("speed", "ends"), [(0.0, "the car stands for 30 s"), (1.0, "")])
def test_a_car_that_stands_for_half_a_minute_of_simulated_time_has_failed(tmp_path, speed, ends, domain, monkeypatch):
    seconds, bar, shown = iter(range(1, 100)), tqdm(total=20, file=io.StringIO()), []

    def drive() -> bool:
        now = next(seconds)
        shown.append(bar.n)
        watch._on_truth(truth(now, speed * now))
        return now == 60

    with Processes(tmp_path, domain) as processes, DriveMonitor(processes, domain) as watch:
        monkeypatch.setattr(module, "LOOK", 0.0)
        verdict = pytest.raises(DriveFailed, match=ends) if ends else nullcontext()
        with verdict:
            watch.wait("drive", drive, is_moving=True, bar=bar)
    assert (shown[:4], shown[-1]) == (([0, 0, 1, 2], 20) if speed else ([0, 0, 0, 0], 0))


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
        processes.run("deaf", deaf)
        while not processes.last_words("deaf") and patience.is_left():
            time.sleep(0.05)
        assert processes.stop("deaf") == -9


PARENT = """
import os, sys, time
from pathlib import Path
from sphere_nav_tools.cli.processes import Processes
with Processes(Path(sys.argv[1]), int(os.environ["ROS_DOMAIN_ID"])) as processes:
    processes.run("sleeper", "import os, time; print(os.getpid(), flush=True); time.sleep(60)")
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
