"""What is whole of a damaged sqlite3 bag comes back, message by message, wherever it was hit."""

from __future__ import annotations

import sqlite3
from contextlib import closing, suppress

import numpy as np
import pytest

pytest.importorskip("rclpy")

from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from sphere_nav.ros.bags import salvage
from sphere_nav.ros.bags.reader import BagReader
from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.bags.sqlite_salvage import SqliteSalvage

STORE = get_typestore(Stores.ROS2_JAZZY)
IMAGE, WORDS = "sensor_msgs/msg/Image", "std_msgs/msg/String"
NUM = 40
SIZES = (10, 3000, 4050, 5000, 60_000)  # bytes of images: within a page, just beyond, and over a chain of pages


def messages():
    types = STORE.types
    for number in range(NUM):
        header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](number, 5), "camera")
        pixels = np.random.default_rng(number).integers(0, 255, SIZES[number % len(SIZES)], np.uint8)
        yield "/image", IMAGE, 10**9 + number, types[IMAGE](header, 1, pixels.size, "mono8", 0, pixels.size, pixels)
        yield "/words", WORDS, 10**9 + number, types[WORDS](f"number {number}")


def write(path, mode=None):
    writer = Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3)
    if mode is not None:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        known = {}
        for topic, kind, stamp, message in messages():
            if topic not in known:
                known[topic] = writer.add_connection(topic, kind, typestore=STORE)
            writer.write(known[topic], stamp, STORE.serialize_cdr(message, kind))
    return path


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return write(tmp_path_factory.mktemp("whole") / "drive")


def contents(path):
    with BagReader(path) as bag:
        return {(topic, stamp): data for topic, stamp, data in bag.raw()}


def file_of(bag):
    return next(bag.glob("*.db3"))


def test_a_whole_database_comes_back_whole(whole, tmp_path):
    assert salvage(whole, tmp_path / "saved") == 2 * NUM
    assert contents(tmp_path / "saved") == contents(whole)
    with BagReader(tmp_path / "saved") as bag:
        assert {info.type for info in bag.topics.values()} == {IMAGE, WORDS}


def test_packed_messages_are_unpacked(whole, tmp_path):
    bag = write(tmp_path / "packed", CompressionMode.MESSAGE)
    salvage(bag, tmp_path / "saved")
    assert contents(tmp_path / "saved") == contents(whole)


@pytest.mark.parametrize("share", [0.3, 0.6, 0.97])
def test_a_cut_database_keeps_what_lies_before_the_cut(whole, tmp_path, share):
    data = file_of(whole).read_bytes()
    cut = tmp_path / "cut.db3"
    cut.write_bytes(data[: int(share * len(data))])
    with pytest.raises(BagError, match="can be salvaged"):
        BagReader(cut)
    expected = contents(whole)
    count = salvage(cut, tmp_path / "saved")
    found = contents(tmp_path / "saved")
    assert len(found) == count > 0.7 * share * len(expected)
    assert found.items() <= expected.items()


def test_pages_that_are_overwritten_cost_their_own_messages_alone(whole, tmp_path):
    data, expected = bytearray(file_of(whole).read_bytes()), contents(whole)
    for page in (40, 90, 91):
        data[4096 * page : 4096 * (page + 1)] = bytes(4096)
    bad = tmp_path / "bad.db3"
    bad.write_bytes(bytes(data))
    salvage(bad, tmp_path / "saved")
    found = contents(tmp_path / "saved")
    assert found.keys() <= expected.keys()
    assert sum(found[key] == expected[key] for key in found) >= 2 * NUM - 30  # a page holds several short ones


def test_no_byte_can_make_it_break(whole, tmp_path):
    """Random damage anywhere: BagError or fewer messages, nothing else."""
    data, rng = file_of(whole).read_bytes(), np.random.default_rng(3)
    bad = tmp_path / "bad.db3"
    for _ in range(15):
        raw = bytearray(data[: int(rng.integers(200, len(data)))])
        for place in rng.integers(0, len(raw), 300):
            raw[place] = int(rng.integers(256))
        bad.write_bytes(bytes(raw))
        with suppress(BagError):
            assert sum(1 for _ in SqliteSalvage(bad).messages()) <= 2 * NUM


def test_a_log_that_was_not_merged_is_part_of_it(tmp_path):
    bag = write(tmp_path / "drive")
    file = file_of(bag)
    with closing(sqlite3.connect(file)) as database:
        database.execute("PRAGMA journal_mode=WAL")
        database.execute("PRAGMA wal_autocheckpoint=0")
        database.execute("UPDATE messages SET timestamp = timestamp + 7")
        database.commit()
        names = [f for f in bag.iterdir() if f.name.startswith(file.name)]
        (tmp_path / "crashed").mkdir()
        for name in names:
            (tmp_path / "crashed" / name.name).write_bytes(name.read_bytes())
    assert salvage(tmp_path / "crashed", tmp_path / "saved") == 2 * NUM
    assert {stamp for _, stamp in contents(tmp_path / "saved")} == {10**9 + number + 7 for number in range(NUM)}


def test_an_empty_message_is_counted_as_lost(tmp_path):
    file = file_of(write(tmp_path / "drive"))
    with closing(sqlite3.connect(file)) as database:
        database.execute("UPDATE messages SET data = X'' WHERE timestamp < ?", (10**9 + 3,))
        database.commit()
    saved = SqliteSalvage(file)
    assert [message.log_time for _, _, message in saved.messages()] == sorted(2 * [10**9 + k for k in range(3, NUM)])
    assert saved.damages == [f"{file}: 6 of 80 messages: expected whole rows, found cut ones"]


def test_another_file_is_refused_in_one_line(tmp_path):
    (tmp_path / "a.db3").write_bytes(b"hello" * 100)
    with pytest.raises(BagError, match="expected an sqlite3 database, found bytes 68 65"):
        salvage(tmp_path / "a.db3", tmp_path / "saved")
    assert not (tmp_path / "saved").exists()
