"""An MCAP file cut anywhere, or with any byte flipped, gives a clear line and never other messages than written."""

from pathlib import Path

import pytest
from mcap.writer import Writer

from sphere_nav.ros.bags import BagError, BagReader
from sphere_nav.ros.bags.mcap_file import McapFile
from sphere_nav.ros.bags.mcap_salvage import readable_part

CUTS = (9, 60, 0.2, 0.5, 0.8, -400, -100, -9, -1)


def test_a_truncated_file_says_how_much_is_readable(make_bag, tmp_path):
    whole = (make_bag() / "bag_0.mcap").read_bytes()
    counts = []
    for cut in CUTS:
        length = int(cut * len(whole)) if isinstance(cut, float) else cut
        path = tmp_path / "cut.mcap"
        path.write_bytes(whole[:length])
        found = readable_part(path)
        expected = rf"cut\.mcap: truncated MCAP: {found.num_messages} messages .* of {path.stat().st_size} bytes"
        with pytest.raises(BagError, match=expected):
            McapFile(path)
        counts.append(found.num_messages)
    assert counts[:2] == [0, 0]
    assert counts[-3:] == [81, 81, 81]  # only the summary is lost
    assert counts[2:5] == sorted(counts[2:5])
    assert set(counts[2:5]) <= {0, 21, 41, 61, 81}  # whole chunks


def test_a_flipped_byte_is_found(make_bag, tmp_path, rng):
    whole = (make_bag() / "bag_0.mcap").read_bytes()
    with BagReader(make_bag("other")) as bag:
        expected = list(bag.raw())
    lines = []
    for place in rng.integers(0, len(whole), 60):
        damaged = bytearray(whole)
        damaged[place] ^= 0x10
        (tmp_path / "damaged.mcap").write_bytes(damaged)
        try:
            with BagReader(tmp_path / "damaged.mcap") as bag:
                assert list(bag.raw()) == expected  # a byte that carries no message
        except BagError as error:
            lines.append(str(error))
    assert not any("\n" in line for line in lines)
    assert len(lines) >= 50  # nearly all bytes of this bag are in chunks, whose checksum covers them


def test_a_file_without_index_is_read_through(tmp_path):
    path = tmp_path / "plain.mcap"
    with path.open("wb") as file:
        writer = Writer(file, use_chunking=False)
        writer.start("ros2")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        channel = writer.register_channel("/text", "cdr", schema)
        for stamp in (3, 1, 2):
            writer.add_message(channel, stamp, bytes([stamp]), stamp)
        writer.finish()
    with BagReader(path) as bag:
        assert [item.message for item in bag.raw()] == [b"\x01", b"\x02", b"\x03"]
        assert bag.num_messages == 3


def test_absurd_sizes_are_refused_before_allocation(make_bag, tmp_path):
    path = make_bag() / "bag_0.mcap"
    file = McapFile(path)
    index = file.summary.chunk_indexes[0]
    data = bytearray(path.read_bytes())
    place = index.chunk_start_offset + 9 + 16  # after opcode, length and two times: the uncompressed size
    assert int.from_bytes(data[place : place + 8], "little") == index.uncompressed_size
    data[place : place + 8] = (1 << 60).to_bytes(8, "little")
    (tmp_path / "bomb.mcap").write_bytes(data)
    with BagReader(tmp_path / "bomb.mcap") as bag, pytest.raises(BagError, match="expected at most"):
        list(bag.raw())
    data[place : place + 8] = (index.uncompressed_size + 1).to_bytes(8, "little")
    (tmp_path / "lie.mcap").write_bytes(data)
    with BagReader(tmp_path / "lie.mcap") as bag, pytest.raises(BagError, match="bytes after decompression"):
        list(bag.raw())


def test_a_file_that_cannot_be_opened():
    with pytest.raises(BagError, match="expected a bag, found no such file"):
        McapFile(Path("/nowhere/bag.mcap"))
