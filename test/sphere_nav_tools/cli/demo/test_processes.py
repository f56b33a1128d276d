"""Nodes as processes: started, watched, ended."""

import subprocess
import sys
import time
from pathlib import Path

import pytest

from sphere_nav_tools.cli.demo.processes import Processes
from worlds.patience import Patience


@pytest.mark.dds
def test_a_node_that_cannot_start_is_told_by_its_last_words(tmp_path, domain):
    with Processes(tmp_path, domain) as processes:
        processes.start("bag_recorder", {"output": ""})  # it needs an output
        patience = Patience(30.0)
        with pytest.raises(RuntimeError, match=r"bag_recorder ended with status 2: .*output"):  # noqa: PT012
            while patience.is_left():
                processes.check()
                time.sleep(0.1)


@pytest.mark.dds
def test_a_running_node_is_ended_in_order_and_completes_its_bag(tmp_path, domain):
    bag = tmp_path / "bag"
    with Processes(tmp_path, domain) as processes:
        processes.start("bag_recorder", {"output": str(bag), "topics": "/nothing"})
        patience = Patience(30.0)
        while "recording into" not in (tmp_path / "bag_recorder.log").read_text() and patience.is_left():
            time.sleep(0.1)
        processes.check()
    assert (bag / "metadata.yaml").is_file()


PARENT = """
import os, sys, time
from pathlib import Path
from sphere_nav_tools.cli.demo.processes import Processes
with Processes(Path(sys.argv[1]), int(os.environ["ROS_DOMAIN_ID"])) as processes:
    processes.run("sleeper", "import os, time; print(os.getpid(), flush=True); time.sleep(60)")
    time.sleep(60)
"""


@pytest.mark.dds
def test_children_end_with_a_parent_that_is_killed(tmp_path):
    parent = subprocess.Popen([sys.executable, "-c", PARENT, str(tmp_path)])
    log, patience = tmp_path / "sleeper.log", Patience(30.0)
    while not (log.is_file() and log.read_text().endswith("\n")) and patience.is_left():
        time.sleep(0.05)
    child = Path(f"/proc/{log.read_text().strip()}")
    assert child.is_dir()
    parent.kill()
    parent.wait()
    while child.is_dir() and patience.is_left():
        time.sleep(0.05)
    assert not child.is_dir()


@pytest.mark.dds
def test_code_that_fails_is_told_and_code_that_ends_well_is_not(tmp_path, domain):
    with Processes(tmp_path, domain) as processes:
        processes.run("good", "print('done')")
        processes.wait("good")
        processes.run("bad", "sys.exit('no kernels')")
        with pytest.raises(RuntimeError, match="bad ended with status 1: no kernels"):
            processes.wait("bad")


def test_topics_have_other_names_where_they_are_given(tmp_path, monkeypatch, domain):
    said = []
    monkeypatch.setattr(Processes, "run", lambda self, name, code, *words: said.append((name, words)))
    processes = Processes(tmp_path, domain)
    processes.start("bag_recorder", {"output": "x"}, {"pose": "mcl/pose", "other/pose": "pose"})
    processes.start("bag_recorder", {"output": "x"})
    file = str(tmp_path / "bag_recorder.yaml")
    plain = ("--ros-args", "--params-file", file)
    assert said == [
        ("bag_recorder", (*plain, "-r", "pose:=mcl/pose", "-r", "other/pose:=pose")),
        ("bag_recorder", plain),
    ]
