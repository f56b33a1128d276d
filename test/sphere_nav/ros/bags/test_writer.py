"""A written bag is a rosbag2 bag, and nothing is overwritten or half there."""

import pytest
import yaml
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from std_msgs.msg import String

from sphere_nav.ros import qos
from sphere_nav.ros.bags import BagError, BagWriter, salvage


def test_an_independent_reader_agrees(make_bag):
    path = make_bag()
    store = get_typestore(Stores.ROS2_JAZZY)
    with Reader(path) as reader:
        assert reader.message_count == 81
        assert reader.start_time == 5_000_000_000
        assert reader.end_time == 8_900_000_001 + 1  # theirs is one after the last message
        kinds = {c.topic: (c.msgtype, c.msgcount, c.digest) for c in reader.connections}
        assert kinds["/text"] == ("std_msgs/msg/String", 40, store.hash_rihs01("std_msgs/msg/String"))
        assert kinds["/stamp"][:2] == ("std_msgs/msg/Header", 40)
        durabilities = {c.topic: c.ext.offered_qos_profiles[0].durability.name for c in reader.connections}
        assert durabilities == {"/latched": "TRANSIENT_LOCAL", "/text": "VOLATILE", "/stamp": "VOLATILE"}
        found = [(c.msgtype, data) for c, _, data in reader.messages() if c.topic == "/text"]
        texts = [store.deserialize_cdr(data, kind).data.split()[0] for kind, data in found]
    assert texts == [str(number) for number in range(40)]


def test_metadata_tells_what_is_in_the_file(make_bag):
    path = make_bag()
    outside = yaml.safe_load((path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    with (path / "bag_0.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        chunks = reader.get_summary().chunk_indexes
    assert outside["version"] == 9
    assert outside["relative_file_paths"] == ["bag_0.mcap"]
    assert outside["message_count"] == 81
    assert outside["duration"]["nanoseconds"] == 3_900_000_001
    assert {index.compression for index in chunks} == {"zstd"}
    assert len(chunks) == 4  # as `make_bag` ends them


def test_a_bag_is_not_there_before_it_is_complete_and_nothing_is_overwritten(make_bag, tmp_path):
    bag = BagWriter(tmp_path / "bag")
    bag.write("text", String(data="a"), 1)
    assert not (tmp_path / "bag").exists()
    assert bag.close() == tmp_path / "bag"
    assert sorted(path.name for path in (tmp_path / "bag").iterdir()) == ["bag_0.mcap", "metadata.yaml"]
    assert not (tmp_path / "bag.partial").exists()
    path = make_bag("made")
    before = (path / "made_0.mcap").read_bytes()
    with pytest.raises(BagError, match="expected no such file or folder"):
        BagWriter(path)
    assert (path / "made_0.mcap").read_bytes() == before
    BagWriter(tmp_path / "cut")
    with pytest.raises(BagError, match=r"cut\.partial: a run that is still writing, or the remains of one"):
        BagWriter(tmp_path / "cut")


def test_an_exception_leaves_nothing_behind_and_a_full_disk_names_the_file(tmp_path, monkeypatch):
    def write(end):
        with BagWriter(tmp_path / "bag") as bag:
            bag.write("text", String(data="a"), 1)
            end(bag)

    def interrupt(bag):
        raise RuntimeError

    def fail():
        raise OSError(28, "No space left on device")

    with pytest.raises(RuntimeError):
        write(interrupt)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(OSError, match=r"No space left on device: '.*bag\.partial/bag_0\.mcap'"):
        write(lambda bag: monkeypatch.setattr(bag._mcap, "finish", fail))
    assert list(tmp_path.iterdir()) == []


def test_what_was_flushed_survives_a_crash(tmp_path):
    bag = BagWriter(tmp_path / "bag")
    for number in range(30):
        bag.write("text", String(data=str(number)), number)
        if number == 20:
            bag.flush()
    assert salvage(tmp_path / "bag.partial", tmp_path / "saved") == 21


def test_a_topic_has_one_type(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic("/a", "std_msgs/msg/String", qos.STATE)
        with pytest.raises(BagError, match="/a: expected std_msgs/msg/String, found std_msgs/msg/Header"):
            bag.add_topic("a", "std_msgs/msg/Header")
