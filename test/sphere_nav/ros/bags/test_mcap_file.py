"""An MCAP file cut or damaged anywhere gives a clear line, never what was not written; `salvage` saves the rest."""

import struct
import tracemalloc

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer

from sphere_nav.ros.bags import BagError, BagReader, salvage
from sphere_nav.ros.bags.mcap_file import MAX_CHUNK, McapFile, read_chunk, whole_messages

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
    return [(channel.topic, message.log_time, message.data) for _, channel, message in whole_messages(path)]


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
    write(tmp_path / "whole.mcap")
    write(tmp_path / "bare.mcap", **options)
    with BagReader(tmp_path / "whole.mcap") as told, BagReader(tmp_path / "bare.mcap") as found:
        assert list(found.raw()) == list(told.raw())
        assert (found.time_range, found.num_messages) == (told.time_range, told.num_messages)
        counts = [{name: (info.type, info.count) for name, info in bag.topics.items()} for bag in (found, told)]
        assert counts[0] == counts[1]
        assert [item.stamp_ns for item in found.raw(["/one"], 5, 9)] == [6, 8]


def test_absurd_sizes_and_places_are_refused(make_bag, tmp_path):
    whole = (make_bag() / "bag_0.mcap").read_bytes()
    place, path = chunks(tmp_path / "bag" / "bag_0.mcap")[0].chunk_start_offset, tmp_path / "absurd.mcap"
    for size in (1 << 60, MAX_CHUNK + 1):
        at = place + 9 + 16  # after opcode, length and two times: the uncompressed size
        path.write_bytes(whole[:at] + size.to_bytes(8, "little") + whole[at + 8 :])
        with path.open("rb") as file, pytest.raises(BagError, match="expected at most"):
            read_chunk(file, place)
    with path.open("rb") as file, pytest.raises(BagError, match="expected a chunk, found Header"):
        read_chunk(file, 8)
    for start in (3, len(whole), 2**63):
        path.write_bytes(whole[:-28] + start.to_bytes(8, "little") + whole[-20:])
        with pytest.raises(BagError, match="damaged summary: expected it before"):
            McapFile(path)
    path.write_bytes(flipped(whole, len(whole) - 60, 3))
    with pytest.raises(BagError, match="damaged summary: checksum: expected"):
        McapFile(path)


def test_a_chunk_that_unpacks_to_more_than_it_says_is_refused_before_memory_is_asked_for(tmp_path, monkeypatch):
    """A chunk of some kilobytes that unpacks to 64 MB of zeros, and says less."""
    path = write_one(tmp_path / "bomb.mcap", [(1, bytes(1 << 26))])
    whole, chunk = path.read_bytes(), chunks(path)[0].chunk_start_offset
    place = chunk + 9 + 16
    path.write_bytes(whole[:place] + (100).to_bytes(8, "little") + whole[place + 8 :])
    monkeypatch.setattr("sphere_nav.ros.bags.mcap_file.MAX_CHUNK", 1 << 24)
    tracemalloc.start()
    with path.open("rb") as file, pytest.raises(BagError, match="expected at most 16777216 bytes, found 671"):
        read_chunk(file, chunk)
    assert salvaged(path) == []
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1 << 23


def test_a_file_that_is_no_bag_is_named_so(tmp_path):
    for content, found in ((b"", "an empty file"), (b"1,2,3\n4,5,6\n", "one of another kind")):
        (tmp_path / "x.mcap").write_bytes(content)
        with pytest.raises(BagError, match=f"x.mcap: expected an MCAP file, found {found}"):
            McapFile(tmp_path / "x.mcap")
