"""Records of an MCAP file: every size is checked against the file and our limits before anything is allocated."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import Any, BinaryIO, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Message, Schema, Statistics

from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.bags.unpack import unpack, unpack_large

MAX_CHUNK = 1 << 28  # bytes after decompression; one message of a chunk is the least that is read at once
MAX_RECORDS = 1 << 20  # in one chunk
PREFIX = struct.Struct("<BQ")  # opcode and length of a record
CHUNK_HEAD = struct.Struct("<QQQII")  # first and last time, size after decompression, CRC, length of the name
MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
MAX_NAME = 8  # characters of the name of a compression
READERS: dict[int, Any] = {
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.STATISTICS: Statistics,
    Opcode.CHUNK_INDEX: ChunkIndex,
}

Record = Schema | Channel | Statistics | ChunkIndex | Message


class ChunkRecord(NamedTuple):
    """A chunk in a file: where it begins and ends, and where its data lie."""

    begin: int
    end: int
    start_ns: int
    end_ns: int
    plain_size: int
    crc: int
    compression: str
    data_begin: int


def read_at(stream: BinaryIO, place: int, num_bytes: int) -> bytes:
    """Return so many bytes from a place; BagError where the file ends before."""
    stream.seek(place)
    found = stream.read(num_bytes)
    if len(found) != num_bytes:
        raise BagError(f"byte {place}: expected {num_bytes} bytes, found {len(found)}")
    return found


def chunk_at(stream: BinaryIO, place: int, size: int) -> ChunkRecord:
    """Return the chunk record at a place of a file of `size` bytes; BagError if there is none."""
    opcode, length = PREFIX.unpack(read_at(stream, place, PREFIX.size))
    end = place + PREFIX.size + length
    if opcode != Opcode.CHUNK or end > size:
        raise BagError(f"byte {place}: expected a chunk within {size} bytes, found record {opcode} of {length} bytes")
    head = read_at(stream, place + PREFIX.size, CHUNK_HEAD.size)
    start_ns, end_ns, plain_size, crc, name_size = CHUNK_HEAD.unpack(head)
    if name_size > MAX_NAME:
        raise BagError(f"chunk at byte {place}: compression: expected a name, found one of {name_size} characters")
    rest = read_at(stream, place + PREFIX.size + CHUNK_HEAD.size, name_size + 8)
    data_begin = place + PREFIX.size + CHUNK_HEAD.size + name_size + 8
    data_size = int.from_bytes(rest[name_size:], "little")
    if data_begin + data_size != end:
        raise BagError(f"chunk at byte {place}: expected data up to byte {end}, found {data_size} bytes")
    name = rest[:name_size].decode("ascii", "replace")
    return ChunkRecord(place, end, start_ns, end_ns, plain_size, crc, name, data_begin)


def records_of_chunk(stream: BinaryIO, chunk: ChunkRecord) -> bytes:
    """Return the decompressed, verified records of a chunk; BagError if it is damaged or its size is absurd."""
    plain = unpack(_packed(stream, chunk), chunk.compression, chunk.plain_size)
    _verify(plain, chunk)
    return plain


def view_of_chunk(stream: BinaryIO, chunk: ChunkRecord) -> memoryview:
    """Return `records_of_chunk` for one that is read as a whole: what `parsed` yields of it lies in it."""
    plain = unpack_large(_packed(stream, chunk), chunk.compression, chunk.plain_size)
    _verify(plain, chunk)
    return plain


def _packed(stream: BinaryIO, chunk: ChunkRecord) -> bytes:
    if max(chunk.plain_size, chunk.end - chunk.data_begin) > MAX_CHUNK:
        raise BagError(f"chunk at byte {chunk.begin}: expected at most {MAX_CHUNK} bytes, found {chunk.plain_size}")
    return read_at(stream, chunk.data_begin, chunk.end - chunk.data_begin)


def _verify(plain: bytes | memoryview, chunk: ChunkRecord) -> None:
    where = f"chunk at byte {chunk.begin}"
    if len(plain) != chunk.plain_size:
        raise BagError(f"{where}: expected {chunk.plain_size} bytes after decompression, found {len(plain)}")
    if chunk.crc and (found := zlib.crc32(plain)) != chunk.crc:
        raise BagError(f"{where}: checksum: expected {chunk.crc:08x}, found {found:08x}")


def parsed(plain: bytes | memoryview) -> Iterator[Record]:
    """Yield schemas, channels, messages, statistics and chunk indexes; other records are passed over.

    The data of messages are copies where `plain` is bytes, else they lie in it.
    """
    place, num_records = 0, 0
    while place < len(plain):
        num_records += 1
        if num_records > MAX_RECORDS:
            raise BagError(f"chunk: expected at most {MAX_RECORDS} records, found more")
        if place + PREFIX.size > len(plain):
            raise BagError(f"record at byte {place}: expected {PREFIX.size} bytes, found {len(plain) - place}")
        opcode, length = PREFIX.unpack_from(plain, place)
        begin, place = place + PREFIX.size, place + PREFIX.size + length
        if place > len(plain):
            raise BagError(f"record at byte {begin}: expected at most {len(plain) - begin} bytes, found {length}")
        if opcode == Opcode.MESSAGE:
            yield message_from(plain[begin:place])
        elif opcode in READERS:
            yield definition_from(opcode, plain[begin:place])


def message_from(content: bytes | memoryview) -> Message:
    """Return a message record from its bytes."""
    if len(content) < MESSAGE_HEAD.size:
        raise BagError(f"message: expected at least {MESSAGE_HEAD.size} bytes, found {len(content)}")
    channel, sequence, log_time, publish_time = MESSAGE_HEAD.unpack_from(content)
    data: Any = content[MESSAGE_HEAD.size :]
    return Message(channel, log_time, data, publish_time, sequence)


def definition_from(opcode: int, content: bytes | memoryview) -> Schema | Channel | Statistics | ChunkIndex:
    """Return a record of the summary, or a definition, from its bytes."""
    kind = READERS[opcode]
    try:
        found: Schema | Channel | Statistics | ChunkIndex = kind.read(ReadDataStream(BytesIO(content)))
    except (McapError, struct.error, UnicodeDecodeError) as error:
        raise BagError(f"{kind.__name__}: expected a whole record, found {type(error).__name__}") from None
    return found
