"""An MCAP file cut or damaged anywhere gives a clear line, never what was not written; `salvage` saves the rest."""

import struct
import tracemalloc

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer

from sphere_nav.ros.bags import BagError, BagReader, salvage
from sphere_nav.ros.bags.mcap_file import McapFile

PREFIX = struct.Struct("<BQ")


def write(path, compression=CompressionType.ZSTD, *, num=40, size=300, **options):
    """Messages in chunks of ten or so; only the first chunk tells their channels."""
    noise = np.random.default_rng(7)
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=10 * size, compression=compression, **options)
        writer.start("ros2", "test")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        channels = [writer.register_channel(name, "cdr", schema) for name in ("/one", "/two")]
        for number in range(num):
            writer.add_message(channels[number % 2], number, noise.bytes(size), number)
        writer.finish()
    return path


def write_one(path, messages, kind="std_msgs/msg/String", encoding="ros2msg", **options):
    """Write stamps and data of one topic."""
    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start("ros2")
        channel = writer.register_channel("/x", "cdr", writer.register_schema(kind, encoding, b"an anvil"))
        for stamp, data in messages:
            writer.add_message(channel, stamp, data, stamp)
        writer.finish()
    return path


def salvaged(path):
    file = McapFile(path, damages=[], is_cut=True)
    try:
        return [(channel.topic, message.log_time, message.data) for channel, message in file.messages()]
    finally:
        file.close()


def chunks(path):
    file = McapFile(path)
    file.close()
    return sorted(file.summary.chunk_indexes, key=lambda index: index.chunk_start_offset)


def flipped(data, place, bit):
    return data[:place] + bytes([data[place] ^ 1 << bit]) + data[place + 1 :]


@pytest.mark.slow
@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4, CompressionType.NONE])
def test_a_flipped_bit_costs_no_more_than_its_chunk_and_no_reader_makes_anything_up(tmp_path, rng, compression):
    path = write(tmp_path / "whole.mcap", compression)
    data, expected, indexes = path.read_bytes(), salvaged(path), chunks(path)
    assert len(expected) == 40
    assert len(indexes) >= 4
    heads = [index.chunk_start_offset + n for index in indexes for n in range(60)]
    end = range(indexes[-1].chunk_start_offset + indexes[-1].chunk_length, len(data))
    damaged, num_refused, places = tmp_path / "damaged.mcap", 0, {*range(40), *heads, *end}
    for place in sorted({*places, *rng.integers(0, len(data), 100).tolist()}):
        damaged.write_bytes(flipped(data, place, int(rng.integers(8))))
        hit = [i for i in indexes if i.chunk_start_offset <= place < i.chunk_start_offset + i.chunk_length]
        spans = [range(i.message_start_time, i.message_end_time + 1) for i in hit]
        others = [item for item in expected if not any(item[1] in span for span in spans)]
        assert salvaged(damaged) in (expected, others), f"byte {place}"
        try:
            with BagReader(damaged) as bag:
                assert [(item.stamp_ns, item.message) for item in bag.raw()] == [item[1:] for item in expected]
        except BagError as error:
            num_refused += "\n" not in str(error)
    assert num_refused > 300


def test_a_cut_at_every_record(tmp_path):
    path = write(tmp_path / "whole.mcap")
    data, expected, indexes = path.read_bytes(), salvaged(path), chunks(path)
    cuts, place = [], 8
    while place < len(data) - 8:
        place += PREFIX.size + PREFIX.unpack_from(data, place)[1]
        cuts += [place - 1, place, place + 1]
    assert len(cuts) > 40
    for cut in cuts:
        path.write_bytes(data[:cut])
        whole = [index for index in indexes if index.chunk_start_offset + index.chunk_length <= cut]
        last = max((index.message_end_time for index in whole), default=-1)
        assert salvaged(path) == [item for item in expected if item[1] <= last]
        with pytest.raises(BagError, match=r"whole\.mcap: truncated MCAP: expected its end, found none: verify-bag"):
            BagReader(path)


def test_types_that_are_not_installed_are_salvaged_with_their_definition(tmp_path):
    path = write_one(tmp_path / "foreign.mcap", [(5, b"abc")], "acme_msgs/msg/Anvil", "ros2idl")
    path.write_bytes(path.read_bytes()[:-1])
    assert salvage(path, tmp_path / "saved") == 1
    with BagReader(tmp_path / "saved") as bag:
        (found,) = bag.files[0].summary.schemas.values()
        assert (found.name, found.encoding, found.data) == ("acme_msgs/msg/Anvil", "ros2idl", b"an anvil")


@pytest.mark.parametrize(
    "options",
    [{"use_chunking": False}, {"use_statistics": False}, {"repeat_channels": False, "repeat_schemas": False}],
    ids=lambda options: next(iter(options)),
)
def test_a_file_without_a_whole_index_is_read_through_and_gives_the_same(options, tmp_path):
    told = McapFile(write(tmp_path / "whole.mcap"))
    found = McapFile(write(tmp_path / "bare.mcap", **options))
    assert [m.data for _, m in found.messages()] == [m.data for _, m in told.messages()]
    assert (found.summary.channels, found.summary.schemas) == (told.summary.channels, told.summary.schemas)
    for name in ("channel_message_counts", "message_count", "message_start_time", "message_end_time"):
        assert getattr(found.statistics, name) == getattr(told.statistics, name)
    assert [m.log_time for _, m in found.messages({1}, 5, 9)] == [6, 8]


def test_absurd_sizes_and_places_are_refused(make_bag, tmp_path):
    whole = (make_bag() / "bag_0.mcap").read_bytes()
    index, path = chunks(tmp_path / "bag" / "bag_0.mcap")[0], tmp_path / "absurd.mcap"
    place = index.chunk_start_offset + 9 + 16  # after opcode, length and two times: the uncompressed size
    for size, line in ((1 << 60, "expected at most"), (index.uncompressed_size + 1, "bytes after decompression")):
        path.write_bytes(whole[:place] + size.to_bytes(8, "little") + whole[place + 8 :])
        with BagReader(path) as bag, pytest.raises(BagError, match=rf"chunk at byte \d+: .*{line}"):
            list(bag.raw())
    for start in (3, len(whole), 2**63):
        path.write_bytes(whole[:-28] + start.to_bytes(8, "little") + whole[-20:])
        with pytest.raises(BagError, match="damaged summary: expected it before"):
            McapFile(path)
    path.write_bytes(flipped(whole, len(whole) - 60, 3))
    with pytest.raises(BagError, match="damaged summary: checksum: expected"):
        McapFile(path)


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4])
def test_a_bomb_is_refused_before_memory_is_asked_for(tmp_path, compression):
    """A chunk of some kilobytes that unpacks to 64 MB of zeros, and says less."""
    path = write_one(tmp_path / "bomb.mcap", [(1, bytes(1 << 26))], compression=compression)
    whole, place = path.read_bytes(), chunks(path)[0].chunk_start_offset + 9 + 16
    path.write_bytes(whole[:place] + (100).to_bytes(8, "little") + whole[place + 8 :])
    tracemalloc.start()
    with BagReader(path) as bag, pytest.raises(BagError, match="expected"):
        list(bag.raw())
    assert salvaged(path) == []
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1 << 23


def test_chunks_that_overlap_in_time_come_in_order(tmp_path):
    messages = [(number % 2 * 10**9 + number, bytes(400)) for number in range(100)]
    path = write_one(tmp_path / "overlap.mcap", messages, chunk_size=1000)
    with BagReader(path) as bag:
        stamps = [item.stamp_ns for item in bag.raw()]
        assert stamps == sorted(stamps)
        assert len(stamps) == 100
