"""`sphere_nav verify-bag`, `record` and `play`."""

import argparse

import pytest
from std_msgs.msg import String

from sphere_nav.params import build
from sphere_nav.ros.bags import BagReader, BagWriter
from sphere_nav.ros.bags.player_node import BagPlayer, PlayerParams
from sphere_nav.ros.bags.recorder_node import SENSORS, BagRecorder, RecorderParams, belongs
from sphere_nav.ros.interfaces import message_class
from sphere_nav_tools.cli.bags import play, record
from sphere_nav_tools.cli.main import main


@pytest.fixture
def bag(tmp_path):
    with BagWriter(tmp_path / "drive") as out:
        for number in range(20):
            out.write("text", String(data=f"{number} " + "x" * 100), 10**9 * (1 + number))
            out.flush()
    return tmp_path / "drive"


def test_a_good_bag(bag, capsys):
    assert main(["verify-bag", str(bag)]) == 0
    out = capsys.readouterr().out
    assert out == f"{bag}: good, 20 messages in 19.0 s\n  /text  20  std_msgs/msg/String\n"


def test_a_damaged_bag(bag, capsys):
    with BagReader(bag) as reader:
        index = reader.files[0].summary.chunk_indexes[5]
    data = bytearray((bag / "drive_0.mcap").read_bytes())
    data[index.chunk_start_offset + index.chunk_length - 20] ^= 1
    (bag / "drive_0.mcap").write_bytes(data)
    assert main(["verify-bag", str(bag)]) == 1
    captured = capsys.readouterr()
    assert "damaged" in captured.out
    assert "drive_0.mcap" in captured.err
    assert captured.err.count("\n") == 1


def test_a_truncated_bag(bag, capsys, tmp_path):
    file = bag / "drive_0.mcap"
    file.write_bytes(file.read_bytes()[:1500])
    assert main(["verify-bag", str(bag)]) == 2
    assert "truncated MCAP" in capsys.readouterr().err
    assert main(["verify-bag", str(bag), "--salvage", str(tmp_path / "saved")]) == 0
    with BagReader(tmp_path / "saved") as reader:
        assert capsys.readouterr().out == f"{tmp_path / 'saved'}: {reader.num_messages} messages salvaged\n"
        assert reader.num_messages > 3


@pytest.fixture
def parameters_of(monkeypatch):
    def given(command, *words):
        calls = []

        def run_node(node_class, args, *, values):
            calls.append((node_class, values))
            if issubclass(node_class, BagPlayer):
                node_class.progress(None, 1, 2)
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
    _, values = parameters_of(record, "-o", "drive", "--set", "all")
    assert values["topic_set"] == "all"


def test_what_a_sensor_tells_is_raw_and_what_is_hidden_is_nobodys():
    assert all(map(message_class, SENSORS))
    for topic, kind, chosen, expected in [
        ("/image_raw", "sensor_msgs/msg/Image", "raw", True),
        ("/anything", "std_msgs/msg/String", "raw", False),
        ("/anything", "std_msgs/msg/String", "all", True),
        ("/_hidden/topic", "std_msgs/msg/String", "all", False),
        ("/image_raw", "sensor_msgs/msg/Image", "", False),
    ]:
        assert belongs(topic, kind, chosen) is expected


def test_play(parameters_of):
    node_class, values = parameters_of(play, "drive")
    assert issubclass(node_class, BagPlayer)
    assert build(PlayerParams, values) == PlayerParams(bag="drive")
    words = "drive --topics /a /b --rate 0 --start 3 --clock --wait-for /a"
    _, values = parameters_of(play, *words.split())
    more = {"clock": True, "wait_for": "/a"}
    assert build(PlayerParams, values) == PlayerParams(bag="drive", topics="/a /b", rate=0.0, start=3.0, **more)
