"""The summary of an MCAP file: what is in it and where. Read from its end, or made by reading the file once."""

from __future__ import annotations

import struct
import zlib
from typing import BinaryIO, NamedTuple

from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Message, Schema, Statistics
from mcap.summary import Summary

from sphere_nav.ros.bags.mcap_chunk import (
    MESSAGE_HEAD,
    PREFIX,
    chunk_at,
    definition_from,
    message_from,
    parsed,
    read_at,
    records_of_chunk,
)
from sphere_nav.ros.bags.recorded import BagError

MAGIC = b"\x89MCAP0\r\n"
FOOTER = struct.Struct("<BQQQI")  # opcode, length, start of the summary, start of its offsets, CRC
MAX_SUMMARY = 1 << 28


class Loose(NamedTuple):
    """A message outside of any chunk: where its record's content lies."""

    begin: int
    length: int
    log_time: int


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
    if not len(MAGIC) <= start <= begin or begin - start > MAX_SUMMARY:
        raise BagError(f"damaged summary: expected it before byte {begin}, found it at {start}")
    content = read_at(stream, start, begin - start)
    if crc and (found := zlib.crc32(footer[:-4], zlib.crc32(content))) != crc:
        raise BagError(f"damaged summary: checksum: expected {crc:08x}, found {found:08x}")
    summary = Summary()
    try:
        for record in parsed(content):
            if not isinstance(record, Message):
                _add(summary, record)
    except BagError as error:
        raise BagError(f"damaged summary: {error}") from None
    return summary


def scan(stream: BinaryIO, size: int) -> tuple[Summary, list[Loose]]:
    """Read a whole file without a summary, or without chunks; BagError where it is damaged."""
    summary, loose = Summary(), list[Loose]()
    summary.statistics = statistics = Statistics(0, 0, {}, 0, 0, 0, 0, 0, 0)
    place = len(MAGIC)
    while place + PREFIX.size <= size:
        opcode, length = PREFIX.unpack(read_at(stream, place, PREFIX.size))
        begin, end = place + PREFIX.size, place + PREFIX.size + length
        if opcode == Opcode.DATA_END:
            break
        if end > size:
            raise BagError(f"byte {place}: expected a record within {size} bytes, found {length} bytes")
        if opcode == Opcode.CHUNK:
            _scan_chunk(stream, place, size, summary)
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            _add(summary, definition_from(opcode, read_at(stream, begin, length)))
        elif opcode == Opcode.MESSAGE:
            head = message_from(read_at(stream, begin, min(length, MESSAGE_HEAD.size)))
            loose.append(Loose(begin, length, head.log_time))
            _count(statistics, head)
        place = end
    summary.statistics = statistics
    return summary, loose


def _scan_chunk(stream: BinaryIO, place: int, size: int, summary: Summary) -> None:
    chunk = chunk_at(stream, place, size)
    own: dict[int, int] = {}
    for record in parsed(records_of_chunk(stream, chunk)):
        if isinstance(record, Message):
            assert summary.statistics is not None
            _count(summary.statistics, record)
            own[record.channel_id] = 0
        elif isinstance(record, Schema | Channel):
            _add(summary, record)
    summary.chunk_indexes.append(
        ChunkIndex(
            chunk_length=chunk.end - place,
            chunk_start_offset=place,
            compression=chunk.compression,
            compressed_size=chunk.end - chunk.data_begin,
            message_end_time=chunk.end_ns,
            message_index_length=0,
            message_index_offsets=own,
            message_start_time=chunk.start_ns,
            uncompressed_size=chunk.plain_size,
        )
    )


def _add(summary: Summary, record: Schema | Channel | Statistics | ChunkIndex) -> None:
    if isinstance(record, Schema):
        summary.schemas[record.id] = record
    elif isinstance(record, Channel):
        summary.channels[record.id] = record
    elif isinstance(record, ChunkIndex):
        summary.chunk_indexes.append(record)
    else:
        summary.statistics = record


def _count(statistics: Statistics, message: Message) -> None:
    counts, stamp = statistics.channel_message_counts, message.log_time
    counts[message.channel_id] = counts.get(message.channel_id, 0) + 1
    is_first = statistics.message_count == 0
    statistics.message_count += 1
    statistics.message_start_time = stamp if is_first else min(statistics.message_start_time, stamp)
    statistics.message_end_time = max(statistics.message_end_time, stamp)
