"""`sphere_nav verify-bag`: a good bag, a damaged one, and what can be saved."""

import json

import pytest
from std_msgs.msg import String

from sphere_nav.ros.bags import BagReader, BagWriter
from sphere_nav_tools.cli.main import main


@pytest.fixture
def bag(tmp_path):
    with BagWriter(tmp_path / "drive") as out:
        for number in range(20):
            out.write("text", String(data=f"{number} " + "x" * 100), 10**9 * (1 + number))
            out.end_chunk()
    return tmp_path / "drive"


def test_a_good_bag(bag, capsys):
    assert main(["verify-bag", str(bag)]) == 0
    out = capsys.readouterr().out
    assert out == f"{bag}: good, 20 messages in 19.0 s\n  /text       20  std_msgs/msg/String\n"


def test_as_json(bag, capsys):
    assert main(["verify-bag", str(bag), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["messages"] == 20
    assert report["topics"] == {"/text": {"type": "std_msgs/msg/String", "count": 20}}
    assert report["problems"] == []


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
