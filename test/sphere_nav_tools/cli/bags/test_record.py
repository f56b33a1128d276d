"""`sphere_nav record` and `play` hand their options to the nodes."""

import argparse

import pytest

from sphere_nav.params import build
from sphere_nav.ros.bags.player_node import BagPlayer, PlayerParams
from sphere_nav.ros.bags.recorder_node import BagRecorder, RecorderParams
from sphere_nav_tools.cli.bags import play, record


@pytest.fixture
def parameters_of(monkeypatch):
    """Parse a command line; return the node that would run and its parameters."""

    def given(command, *words):
        calls = []

        def run_node(node_class, args, *, values, prepare=None):
            calls.append((node_class, values))
            if prepare is not None:
                node = argparse.Namespace()
                prepare(node)
                node.progress(1, 2)
            return 0

        monkeypatch.setattr(command, "run_node", run_node)
        parser = argparse.ArgumentParser()
        command.add_arguments(parser)
        assert command.run(parser.parse_args(words)) == 0
        return calls[0]

    return given


def test_record(parameters_of):
    node_class, values = parameters_of(record, "-o", "drive", "--set", "raw", "--use-sim-time")
    assert node_class is BagRecorder
    assert values.pop("use_sim_time") is True
    assert build(RecorderParams, values) == RecorderParams(output="drive", topic_set="raw")
    _, values = parameters_of(record, "-o", "drive", "/a", "/b", "--uncompressed")
    del values["use_sim_time"]
    assert build(RecorderParams, values) == RecorderParams(output="drive", topics="/a /b", compressed=False)
    _, values = parameters_of(record, "-o", "drive", "--all")
    assert values["topic_set"] == "all"


def test_play(parameters_of):
    node_class, values = parameters_of(play, "drive")
    assert node_class is BagPlayer
    assert build(PlayerParams, values) == PlayerParams(bag="drive")
    words = (
        "drive --topics /a /b --rate 0 --start 3 --clock --paused --loop --wait-for /a --answer status --answered /b"
    )
    _, values = parameters_of(play, *words.split())
    expected = PlayerParams(
        bag="drive",
        topics="/a /b",
        rate=0.0,
        start=3.0,
        clock=True,
        paused=True,
        loop=True,
        wait_for="/a",
        answer_topic="status",
        answered_topic="/b",
    )
    assert build(PlayerParams, values) == expected
