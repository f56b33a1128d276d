"""One flipped bit anywhere, or a cut at any record: all messages that it did not hit come back, and no other ones."""

import numpy as np
import pytest
from mcap.records import ChunkIndex
from mcap.writer import CompressionType, Writer

from sphere_nav.ros.bags import BagError, BagReader, salvage
from sphere_nav.ros.bags.mcap_file import McapFile
from sphere_nav.ros.bags.mcap_records import PREFIX
from sphere_nav.ros.bags.mcap_salvage import Salvage, readable_part


def write(path, compression=CompressionType.ZSTD, *, num=40, size=300, seed=7):
    """Messages in chunks of ten or so; only the first chunk tells their channels."""
    noise = np.random.default_rng(seed)
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=10 * size, compression=compression)
        writer.start("ros2", "test")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        channels = [writer.register_channel(name, "cdr", schema) for name in ("/one", "/two")]
        for number in range(num):
            writer.add_message(channels[number % 2], number, noise.bytes(size), number)
        writer.finish()
    return path


def salvaged(path):
    return [(channel.topic, message.log_time, message.data) for channel, _, message in Salvage(path).messages()]


def chunks(path) -> list[ChunkIndex]:
    file = McapFile(path)
    file.close()
    return sorted(file.summary.chunk_indexes, key=lambda index: index.chunk_start_offset)


def chunk_of(place, indexes):
    for index in indexes:
        if index.chunk_start_offset <= place < index.chunk_start_offset + index.chunk_length:
            return index
    return None


@pytest.mark.slow
@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4, CompressionType.NONE])
def test_a_flipped_bit_costs_no_more_than_the_chunk_that_it_hit(tmp_path, rng, compression):
    path = write(tmp_path / "whole.mcap", compression)
    data, expected, indexes = path.read_bytes(), salvaged(path), chunks(path)
    assert len(expected) == 40
    assert len(indexes) >= 4
    heads = [index.chunk_start_offset + n for index in indexes for n in range(60)]
    behind = [index.chunk_start_offset + index.chunk_length + n for index in indexes for n in range(40)]
    end = range(indexes[-1].chunk_start_offset + indexes[-1].chunk_length, len(data))
    damaged = tmp_path / "damaged.mcap"
    for place in sorted({*range(40), *heads, *behind, *end, *rng.integers(0, len(data), 100).tolist()}):
        if place >= len(data):
            continue
        bit = int(rng.integers(8))
        damaged.write_bytes(data[:place] + bytes([data[place] ^ 1 << bit]) + data[place + 1 :])
        hit = chunk_of(place, indexes)
        kept = salvaged(damaged)
        if hit is None:
            assert kept == expected, f"byte {place}, bit {bit}: nothing of a message was hit"
        else:
            others = [item for item in expected if not hit.message_start_time <= item[1] <= hit.message_end_time]
            assert kept in (expected, others), f"byte {place}, bit {bit}"


def test_every_bit_of_the_head_of_a_chunk(tmp_path):
    path = write(tmp_path / "whole.mcap")
    data, expected, indexes = path.read_bytes(), salvaged(path), chunks(path)
    first, others = indexes[0].chunk_start_offset, [one for one in expected if one[1] > indexes[0].message_end_time]
    for bit in range(8 * (9 + 32 + 4 + 8)):
        flipped = bytearray(data)
        flipped[first + bit // 8] ^= 1 << bit % 8
        path.write_bytes(flipped)
        assert salvaged(path) in (expected, others), f"byte {bit // 8}, bit {bit % 8}"


def test_a_reader_never_returns_what_was_not_written(tmp_path, rng):
    path = write(tmp_path / "whole.mcap")
    data, expected = path.read_bytes(), [item[1:] for item in salvaged(path)]
    num_refused = 0
    for place in rng.integers(0, len(data), 400).tolist():
        (tmp_path / "damaged.mcap").write_bytes(data[:place] + bytes([data[place] ^ 0x40]) + data[place + 1 :])
        try:
            with BagReader(tmp_path / "damaged.mcap") as bag:
                assert [(item.stamp_ns, item.message) for item in bag.raw()] == expected
        except BagError:
            num_refused += 1
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
        with pytest.raises(BagError, match="truncated MCAP: "):
            BagReader(path)


def test_a_salvaged_bag_is_a_bag_again(tmp_path):
    path = write(tmp_path / "whole.mcap")
    data, index = bytearray(path.read_bytes()), chunks(path)[0]
    data[index.chunk_start_offset + index.chunk_length // 2] ^= 1
    path.write_bytes(data)
    found = readable_part(path)
    assert found.num_messages == salvage(path, tmp_path / "saved") < 40
    assert "checksum" in found.error or "zstd" in found.error
    with BagReader(tmp_path / "saved") as bag:
        assert bag.num_messages == found.num_messages
        assert set(bag.topics) == {"/one", "/two"}


def test_types_that_are_not_installed_are_salvaged_with_their_definition(tmp_path):
    path = tmp_path / "foreign.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        schema = writer.register_schema("acme_msgs/msg/Anvil", "ros2idl", b"an anvil")
        writer.add_message(writer.register_channel("/anvil", "cdr", schema), 5, b"abc", 5)
        writer.finish()
    path.write_bytes(path.read_bytes()[:-1])
    assert salvage(path, tmp_path / "saved") == 1
    with BagReader(tmp_path / "saved") as bag:
        (found,) = bag.files[0].summary.schemas.values()
        assert (found.name, found.encoding, found.data) == ("acme_msgs/msg/Anvil", "ros2idl", b"an anvil")


def test_a_file_of_another_kind_holds_nothing(tmp_path):
    for data in (b"", b"hello", bytes(100_000), bytes(range(256)) * 100):
        (tmp_path / "other").write_bytes(data)
        assert salvaged(tmp_path / "other") == []
    with pytest.raises(BagError, match="no such file"):
        salvaged(tmp_path / "absent")
