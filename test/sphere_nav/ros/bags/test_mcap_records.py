"""What a small file unpacks to is bounded, whichever way it is read."""

import resource
import struct
import zlib

import lz4.frame
import pytest
import zstandard
from mcap.writer import Writer

from sphere_nav.ros.bags import BagError, BagReader
from sphere_nav.ros.bags.mcap_records import MAX_CHUNK, MAX_RECORDS, parsed, read_summary, scan
from sphere_nav.ros.bags.mcap_salvage import Salvage

HUGE = 1 << 30


def bomb(compression, told):
    """A chunk of some kilobytes that unpacks to 1 GB of zeros."""
    if compression == "zstd":
        packer = zstandard.ZstdCompressor(level=3).compressobj(size=HUGE)
        data = b"".join(packer.compress(bytes(1 << 24)) for _ in range(HUGE >> 24)) + packer.flush()
    else:
        packer = lz4.frame.LZ4FrameCompressor(block_size=lz4.frame.BLOCKSIZE_MAX4MB)
        data = packer.begin() + b"".join(packer.compress(bytes(1 << 24)) for _ in range(HUGE >> 24)) + packer.flush()
    head = struct.pack("<QQQII", 0, 1, told, 0, len(compression)) + compression.encode()
    content = head + struct.pack("<Q", len(data)) + data
    return struct.pack("<BQ", 6, len(content)) + content


def file_with(chunk, num_index=0):
    """An MCAP file with one chunk, without a summary or with so many index entries for it."""
    magic = b"\x89MCAP0\r\n"
    body = magic + struct.pack("<BQ", 1, 8) + bytes(8)
    place = len(body)
    body += chunk + struct.pack("<BQI", 15, 4, 0)
    index = struct.pack("<QQQQIQIQQ", 0, 1, place, len(chunk), 0, 0, 0, 0, 0)
    summary = (struct.pack("<BQ", 8, len(index)) + index) * num_index
    start = len(body) if summary else 0
    footer = struct.pack("<BQQQ", 2, 20, start, 0)
    crc = zlib.crc32(summary + footer) if summary else 0
    return body + summary + footer + struct.pack("<I", crc) + magic


@pytest.mark.slow
@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_a_bomb_is_refused_before_memory_is_asked_for(tmp_path, compression):
    path = tmp_path / "bomb.mcap"
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    right = bomb(compression, HUGE)
    for told in (HUGE, MAX_CHUNK // 2, 100):
        chunk = right[:25] + struct.pack("<Q", told) + right[33:]
        for num_index in (0, 200):
            path.write_bytes(file_with(chunk, num_index))
            with pytest.raises(BagError, match="expected"), BagReader(path, is_empty_allowed=True) as bag:
                list(bag.raw())
        assert list(Salvage(path).messages()) == []
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 700_000  # KB


def test_many_entries_for_one_chunk_are_one_chunk(tmp_path):
    message = struct.pack("<BQHIQQ", 5, 22 + 4, 1, 0, 7, 7) + b"data"
    channel = struct.pack("<HHI", 1, 0, 2) + b"/x" + struct.pack("<I", 3) + b"cdr" + struct.pack("<I", 0)
    records = struct.pack("<BQ", 4, len(channel)) + channel + message
    head = struct.pack("<QQQII", 0, 9, len(records), zlib.crc32(records), 0) + struct.pack("<Q", len(records)) + records
    chunk = struct.pack("<BQ", 6, len(head)) + head
    (tmp_path / "plain.mcap").write_bytes(file_with(chunk))
    with BagReader(tmp_path / "plain.mcap") as bag:
        assert [item.message for item in bag.raw()] == [b"data"]
    (tmp_path / "many.mcap").write_bytes(file_with(chunk, 200))  # its summary has no channels
    with pytest.raises(BagError, match="expected a channel of the summary, found channel 1"):
        list(BagReader(tmp_path / "many.mcap", is_empty_allowed=True).raw())


def test_chunks_that_overlap_in_time_are_held_up_to_a_limit(tmp_path, monkeypatch):
    path = tmp_path / "overlap.mcap"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=1000)
        writer.start("ros2")
        channel = writer.register_channel("/x", "cdr", writer.register_schema("std_msgs/msg/String", "ros2msg", b""))
        for number in range(100):
            writer.add_message(channel, number % 2 * 10**9 + number, bytes(400), 0)
        writer.finish()
    with BagReader(path) as bag:
        stamps = [item.stamp_ns for item in bag.raw()]
        assert stamps == sorted(stamps)
        assert len(stamps) == 100
        monkeypatch.setattr("sphere_nav.ros.bags.mcap_file.MAX_HELD", 10_000)
        with pytest.raises(BagError, match="expected chunks in order of time, found 10000 bytes that overlap"):
            list(bag.raw())


@pytest.mark.slow
def test_records_that_do_not_fit():
    message = struct.pack("<BQ", 5, 22) + bytes(22)
    assert len(list(parsed(message * 3))) == 3
    for damaged in (message[:-1], message[:5], struct.pack("<BQ", 5, 1 << 60), struct.pack("<BQ", 5, 3) + b"abc"):
        with pytest.raises(BagError, match="expected"):
            list(parsed(message + damaged))
    with pytest.raises(BagError, match=f"expected at most {MAX_RECORDS} records"):
        for _ in parsed(message * (MAX_RECORDS + 1)):
            pass


def test_both_ways_lead_to_the_same(make_bag):
    path = make_bag() / "bag_0.mcap"
    with path.open("rb") as stream:
        told = read_summary(stream, path.stat().st_size)
        found, loose = scan(stream, path.stat().st_size)
    assert loose == []
    assert found.channels == told.channels
    assert found.schemas == told.schemas
    assert [index.chunk_start_offset for index in found.chunk_indexes] == [
        index.chunk_start_offset for index in told.chunk_indexes
    ]
    assert found.statistics.channel_message_counts == told.statistics.channel_message_counts
    assert found.statistics.message_start_time == told.statistics.message_start_time
    assert found.statistics.message_end_time == told.statistics.message_end_time


def test_a_summary_that_lies_elsewhere(make_bag, tmp_path):
    data = bytearray((make_bag() / "bag_0.mcap").read_bytes())
    path = tmp_path / "x"
    for start in (3, len(data), 2**63):
        data[-8 - 20 : -8 - 12] = start.to_bytes(8, "little")
        path.write_bytes(data)
        with path.open("rb") as stream, pytest.raises(BagError, match="damaged summary: expected it before"):
            read_summary(stream, len(data))
    with path.open("rb") as stream, pytest.raises(BagError, match="expected a footer, found a file of 30"):
        read_summary(stream, 30)
