"""Reading, and one clear line for every fault of a bag."""

import shutil

import pytest
from mcap.writer import Writer
from rclpy.serialization import serialize_message as to_bytes
from std_msgs.msg import Header, String

from sphere_nav.ros.bags import BagError, BagReader, BagWriter
from sphere_nav.ros.bags.check import salvage
from sphere_nav.ros.interfaces import type_hash


def test_messages_come_in_order_of_time(make_bag):
    with BagReader(make_bag()) as bag:
        assert bag.num_messages == 81
        assert bag.time_range == (5_000_000_000, 8_900_000_001)
        assert {name: (info.type, info.count) for name, info in bag.topics.items()} == {
            "/latched": ("std_msgs/msg/String", 1),
            "/text": ("std_msgs/msg/String", 40),
            "/stamp": ("std_msgs/msg/Header", 40),
        }
        stamps = [item.stamp_ns for item in bag.messages()]
        assert stamps == sorted(stamps)
        assert [item.message.frame_id for item in bag.messages(["stamp"])] == [str(n) for n in range(40)]
        late = list(bag.raw(["/stamp"], 8_000_000_000, 8_200_000_001))
        assert [bag.decode("/stamp", item.message, Header).frame_id for item in late] == ["30", "31", "32"]


def test_messages_written_out_of_order_are_sorted(tmp_path):
    stamps = [5, 3, 9, 1, 7, 3]
    with BagWriter(tmp_path / "bag") as bag:
        for number, stamp in enumerate(stamps):
            bag.write("text", String(data=str(number)), stamp)
            bag.flush()
    with BagReader(tmp_path / "bag") as reader:
        found = [(item.stamp_ns, item.message.data) for item in reader.messages()]
    assert found == [(1, "3"), (3, "1"), (3, "5"), (5, "0"), (7, "4"), (9, "2")]


def test_a_lone_file_and_a_folder_without_metadata_are_bags(make_bag):
    path = make_bag()
    assert BagReader(path / "bag_0.mcap").num_messages == 81
    (path / "metadata.yaml").unlink()
    assert BagReader(path).num_messages == 81


def write_mixed(path, encodings):
    """An MCAP whose topics /0, /1 have these encodings, as a bridge writes them; only CDR has messages of ROS 2."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        for number, encoding in enumerate(encodings):
            kind = "std_msgs/msg/String" if encoding == "cdr" else "foxglove.Log"
            schema = writer.register_schema(kind, "any", b"string data")
            channel = writer.register_channel(f"/{number}", encoding, schema)
            for stamp in range(3):
                data = to_bytes(String(data=str(stamp))) if encoding == "cdr" else b"{}"
                writer.add_message(channel, stamp + 1, data, stamp + 1)
        writer.finish()
    return path


def test_a_topic_of_another_encoding_is_named_and_the_others_are_read(tmp_path, caplog):
    path = write_mixed(tmp_path / "mixed.mcap", ["json", "cdr", "protobuf"])
    for _ in range(2):
        with BagReader(path) as bag:
            assert {name: info.count for name, info in bag.topics.items()} == {"/1": 3}
            assert [item.message.data for item in bag.messages()] == ["0", "1", "2"]
            assert bag.num_messages == len([*bag.raw()]) == 3
    line = f"{path}: not readable, passed over: /0 (json), /2 (protobuf): expected encoding cdr"
    assert [record.message for record in caplog.records] == [line]
    assert salvage(path, tmp_path / "saved") == 3
    with pytest.raises(BagError, match=r"none.mcap: expected topics of encoding cdr, found /0 \(ros1\)"):
        BagReader(write_mixed(tmp_path / "none.mcap", ["ros1"]))


def test_several_files_are_one_bag(make_bag, tmp_path):
    first, second = make_bag("first", 10), make_bag("second", 20)
    both = tmp_path / "both"
    both.mkdir()
    shutil.copy(first / "first_0.mcap", both / "both_0.mcap")
    shutil.copy(second / "second_0.mcap", both / "both_1.mcap")
    with BagReader(both) as bag:
        assert bag.num_messages == 21 + 41
        stamps = [item.stamp_ns for item in bag.raw()]
    assert len(stamps) == 62
    assert stamps == sorted(stamps)


def test_an_absent_cut_or_empty_bag(tmp_path):
    expected = r"nothing: expected a bag \(a folder, or a file \.mcap, \.db3 or \.bag\), found none"
    with pytest.raises(BagError, match=expected) as error:
        BagReader(tmp_path / "nothing")
    assert "\n" not in str(error.value)
    BagWriter(tmp_path / "cut")
    with pytest.raises(BagError, match=r"found .*cut\.partial of an interrupted run"):
        BagReader(tmp_path / "cut")
    (empty := tmp_path / "folder").mkdir()
    with pytest.raises(BagError, match=r"expected metadata\.yaml, \.mcap, \.db3 or \.bag files, found none"):
        BagReader(empty)


def test_a_topic_that_is_not_there_names_those_that_are_and_one_of_another_type_or_definition_its_own(make_bag):
    with BagReader(make_bag()) as bag:
        assert bag.require("text", String).count == 40
        expected = r"expected topic /image_raw, found /latched \(std_msgs/msg/String\), /stamp"
        with pytest.raises(BagError, match=expected):
            bag.require("image_raw")
        with pytest.raises(BagError, match="/text: expected std_msgs/msg/Header, found std_msgs/msg/String"):
            bag.require("text", Header)
        bag.topics["/text"].hash = "RIHS01_00"
        with pytest.raises(BagError, match=f"expected definition {type_hash('std_msgs/msg/String')}, found RIHS01_00"):
            next(bag.messages(["text"]))
