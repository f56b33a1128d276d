"""Nodes as processes: started, watched, ended."""

import time

import pytest

from sphere_nav_cli.driving.processes import Processes

DOMAIN = 47


def test_a_node_that_cannot_start_is_told_by_its_last_words(tmp_path):
    with Processes(tmp_path, DOMAIN) as processes:
        processes.start("bag_recorder", {"output": ""})  # it needs an output
        limit = time.monotonic() + 30.0
        with pytest.raises(RuntimeError, match=r"bag_recorder ended with status 2: .*output"):  # noqa: PT012
            while time.monotonic() < limit:
                processes.check()
                time.sleep(0.1)


def test_a_running_node_is_ended_in_order_and_completes_its_bag(tmp_path):
    bag = tmp_path / "bag"
    with Processes(tmp_path, DOMAIN) as processes:
        processes.start("bag_recorder", {"output": str(bag), "topics": "/nothing"})
        limit = time.monotonic() + 30.0
        while "recording into" not in (tmp_path / "bag_recorder.log").read_text() and time.monotonic() < limit:
            time.sleep(0.1)
        processes.check()
    assert (bag / "metadata.yaml").is_file()
