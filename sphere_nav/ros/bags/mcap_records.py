"""Records of an MCAP file: every size is checked against the file and our limits before anything is allocated.

`mcap` knows the fields of each record. Its own readers ask for whatever memory a field says, unpack chunks without a
limit, keep any number of records and do not look at the checksum of the summary.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import Any, BinaryIO, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, Message, Schema, Statistics
from mcap.summary import Summary

from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.bags.unpack import unpack, unpack_large

MAX_CHUNK = 1 << 28  # bytes after decompression; one message of a chunk is the least that is read at once
MAX_RECORDS = 1 << 20  # in one chunk
MAGIC = b"\x89MCAP0\r\n"
PREFIX = struct.Struct("<BQ")  # opcode and length of a record
FOOTER = struct.Struct("<BQQQI")  # opcode, length, start of the summary, start of its offsets, CRC
MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
DEFINITIONS: dict[int, Any] = {
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.STATISTICS: Statistics,
    Opcode.CHUNK_INDEX: ChunkIndex,
}

Record = Schema | Channel | Statistics | ChunkIndex | Message


class Loose(NamedTuple):
    """A message outside of any chunk: where its record lies."""

    begin: int
    end: int
    log_time: int


class _Content(ReadDataStream):
    """The content of a record of so many bytes: no field reaches beyond its end."""

    def __init__(self, stream: Any, num_bytes: int) -> None:
        super().__init__(stream)
        self._num_bytes = num_bytes

    def read(self, length: int) -> bytes:
        """Return so many bytes; EndOfFile where the record ends before."""
        if length > self._num_bytes - self.count:
            raise EndOfFile
        return super().read(length)


def read_at(stream: BinaryIO, place: int, num_bytes: int) -> bytes:
    """Return so many bytes from a place; BagError where the file ends before."""
    stream.seek(place)
    found = stream.read(num_bytes)
    if len(found) != num_bytes:
        raise BagError(f"byte {place}: expected {num_bytes} bytes, found {len(found)}")
    return found


def walk(stream: BinaryIO, size: int) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, begin and end of each record up to the end of the data; BagError for one beyond the file's end."""
    place = len(MAGIC)
    while place + PREFIX.size <= size:
        opcode, length = PREFIX.unpack(read_at(stream, place, PREFIX.size))
        end = place + PREFIX.size + length
        if opcode == Opcode.DATA_END:
            return
        if opcode == 0 or end > size:
            raise BagError(f"byte {place}: expected a record within {size} bytes, found {opcode} of {length} bytes")
        yield opcode, place, end
        place = end


def records_at(stream: BinaryIO, place: int, size: int, *, is_view: bool = False) -> Iterator[Record]:
    """Yield the records of the chunk at a place of a file of `size` bytes; BagError where it is damaged, or none.

    The data of messages are copies; with `is_view` they lie in the unpacked chunk, for one that is read as a whole.
    """
    try:
        opcode, length = PREFIX.unpack(read_at(stream, place, PREFIX.size))
        if opcode != Opcode.CHUNK or place + PREFIX.size + length > size:
            raise BagError(f"expected a chunk within {size} bytes, found record {opcode} of {length} bytes")
        if length > MAX_CHUNK:
            raise BagError(f"expected at most {MAX_CHUNK} bytes, found {length}")
        chunk = _read(Chunk, stream, length)
        if chunk.uncompressed_size > MAX_CHUNK:
            raise BagError(f"expected at most {MAX_CHUNK} bytes, found {chunk.uncompressed_size}")
        plain = (unpack_large if is_view else unpack)(chunk.data, chunk.compression, chunk.uncompressed_size)
        if len(plain) != chunk.uncompressed_size:
            raise BagError(f"expected {chunk.uncompressed_size} bytes after decompression, found {len(plain)}")
        if chunk.uncompressed_crc and (found := zlib.crc32(plain)) != chunk.uncompressed_crc:
            raise BagError(f"checksum: expected {chunk.uncompressed_crc:08x}, found {found:08x}")
        yield from parsed(plain)
    except BagError as error:
        raise BagError(f"chunk at byte {place}: {error}") from None


def record_at(stream: BinaryIO, begin: int, end: int) -> Any:
    """Return a message or a definition that lies outside of any chunk."""
    if end - begin > MAX_CHUNK:
        raise BagError(f"byte {begin}: expected a record of at most {MAX_CHUNK} bytes, found {end - begin}")
    return next(parsed(read_at(stream, begin, end - begin)))


def parsed(plain: bytes | memoryview) -> Iterator[Record]:
    """Yield messages and definitions; other records are passed over.

    The data of messages are copies where `plain` is bytes, else they lie in it.
    """
    place, num_records = 0, 0
    while place < len(plain):
        num_records += 1
        if num_records > MAX_RECORDS:
            raise BagError(f"expected at most {MAX_RECORDS} records, found more")
        if place + PREFIX.size > len(plain):
            raise BagError(f"record at byte {place}: expected {PREFIX.size} bytes, found {len(plain) - place}")
        opcode, length = PREFIX.unpack_from(plain, place)
        begin, place = place + PREFIX.size, place + PREFIX.size + length
        if place > len(plain):
            raise BagError(f"record at byte {begin}: expected at most {len(plain) - begin} bytes, found {length}")
        if opcode == Opcode.MESSAGE:
            yield message_from(plain[begin:place])
        elif opcode in DEFINITIONS:
            yield _read(DEFINITIONS[opcode], BytesIO(plain[begin:place]), length)


def message_from(content: bytes | memoryview) -> Message:
    """Return a message record from its bytes."""
    if len(content) < MESSAGE_HEAD.size:
        raise BagError(f"message: expected at least {MESSAGE_HEAD.size} bytes, found {len(content)}")
    channel, sequence, log_time, publish_time = MESSAGE_HEAD.unpack_from(content)
    data: Any = content[MESSAGE_HEAD.size :]
    return Message(channel, log_time, data, publish_time, sequence)


def read_summary(stream: BinaryIO, size: int) -> Summary | None:
    """Return the summary of a complete file, None where it has none; BagError where it is damaged."""
    begin = size - len(MAGIC) - FOOTER.size
    if begin < len(MAGIC):
        raise BagError(f"damaged summary: expected a footer, found a file of {size} bytes")
    footer = read_at(stream, begin, FOOTER.size)
    opcode, length, start, _, crc = FOOTER.unpack(footer)
    if opcode != Opcode.FOOTER or length != FOOTER.size - PREFIX.size:
        raise BagError(f"damaged summary: expected a footer at byte {begin}, found record {opcode} of {length} bytes")
    if start == 0:
        return None
    if not len(MAGIC) <= start <= begin or begin - start > MAX_CHUNK:
        raise BagError(f"damaged summary: expected it before byte {begin}, found it at {start}")
    content = read_at(stream, start, begin - start)
    if crc and (found := zlib.crc32(footer[:-4], zlib.crc32(content))) != crc:
        raise BagError(f"damaged summary: checksum: expected {crc:08x}, found {found:08x}")
    summary = Summary()
    try:
        for record in parsed(content):
            _add(summary, record)
    except BagError as error:
        raise BagError(f"damaged summary: {error}") from None
    return summary


def scan(stream: BinaryIO, size: int) -> tuple[Summary, list[Loose]]:
    """Read a whole file without a summary, or without chunks; BagError where it is damaged."""
    summary, loose = Summary(), list[Loose]()
    summary.statistics = statistics = Statistics(0, 0, {}, 0, 0, 0, 0, 0, 0)
    for opcode, begin, end in walk(stream, size):
        if opcode == Opcode.CHUNK:
            stamps: list[int] = []
            own: dict[int, int] = {}
            for record in records_at(stream, begin, size):
                _add(summary, record)
                if isinstance(record, Message):
                    _count(statistics, record)
                    stamps.append(record.log_time)
                    own[record.channel_id] = 0
            first, last = min(stamps, default=0), max(stamps, default=0)
            summary.chunk_indexes.append(ChunkIndex(end - begin, begin, "", 0, last, 0, own, first, 0))
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            _add(summary, record_at(stream, begin, end))
        elif opcode == Opcode.MESSAGE:
            head = message_from(read_at(stream, begin + PREFIX.size, min(end - begin - PREFIX.size, MESSAGE_HEAD.size)))
            loose.append(Loose(begin, end, head.log_time))
            _count(statistics, head)
    return summary, loose


def _count(statistics: Statistics, message: Message) -> None:
    counts, stamp = statistics.channel_message_counts, message.log_time
    counts[message.channel_id] = counts.get(message.channel_id, 0) + 1
    is_first = statistics.message_count == 0
    statistics.message_count += 1
    statistics.message_start_time = stamp if is_first else min(statistics.message_start_time, stamp)
    statistics.message_end_time = max(statistics.message_end_time, stamp)


def _add(summary: Summary, record: Record) -> None:
    if isinstance(record, Schema):
        summary.schemas[record.id] = record
    elif isinstance(record, Channel):
        summary.channels[record.id] = record
    elif isinstance(record, ChunkIndex):
        summary.chunk_indexes.append(record)
    elif isinstance(record, Statistics):
        summary.statistics = record


def _read(kind: Any, stream: BinaryIO, num_bytes: int) -> Any:
    try:
        return kind.read(_Content(stream, num_bytes))
    except (McapError, struct.error, UnicodeDecodeError) as error:
        raise BagError(f"{kind.__name__}: expected a whole record, found {type(error).__name__}") from None
