"""One MCAP file as an untrusted input: sizes are checked before anything is allocated, CRCs always."""

from __future__ import annotations

import heapq
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import zstandard
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, SeekingReader
from mcap.records import Channel, Chunk, ChunkIndex, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.summary import Summary

from node_kit.bag_error import BagError

MAGIC = b"\x89MCAP0\r\n"
MAX_CHUNK = 1 << 31  # bytes after decompression
ERRORS = (McapError, struct.error, zstandard.ZstdError, ValueError, KeyError, EOFError, RuntimeError, MemoryError)
"""What the mcap library raises on damaged files."""


class Readable(NamedTuple):
    """How much of a truncated or damaged file is readable."""

    num_messages: int
    start_ns: int
    end_ns: int
    num_bytes: int
    error: str


class McapFile:
    """An MCAP file with its summary; BagError if it is none, or not complete."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self.size = path.stat().st_size
            self.stream = path.open("rb")
        except OSError as error:
            raise BagError(f"{path}: cannot be read: {error.strerror}") from None
        try:
            self._check_ends()
            self.summary = self._read_summary()
        except BaseException:
            self.stream.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self.stream.close()

    def messages(
        self, channels: set[int] | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[tuple[Channel, Message]]:
        """Yield the messages of some channels from `start_ns` to `end_ns`, both included, in order of log time."""
        stamps = (0 if start_ns is None else start_ns, 2**64 if end_ns is None else end_ns)
        try:
            yield from self._ordered(channels, *stamps)
        except BagError:
            raise
        except ERRORS as error:
            raise BagError(f"{self.path}: damaged: {one_line(error)}") from None

    def chunk(self, index: ChunkIndex) -> list[tuple[Channel, Message]]:
        """Return the messages of one chunk in the order of the file; BagError if it is damaged."""
        try:
            return self._chunk(index)
        except BagError:
            raise
        except ERRORS as error:
            raise BagError(f"{self.path}: chunk at byte {index.chunk_start_offset}: {one_line(error)}") from None

    def _ordered(self, channels: set[int] | None, start: int, end: int) -> Iterator[tuple[Channel, Message]]:
        queue: list[tuple[int, int, int, Any]] = [
            (index.message_start_time, index.chunk_start_offset, -1, index)
            for index in self.summary.chunk_indexes
            if index.message_end_time >= start and index.message_start_time <= end and _may_hold(index, channels)
        ]
        if not self.summary.chunk_indexes:
            queue = [
                (message.log_time, 0, i, (channel, message)) for i, (channel, message) in enumerate(self._linear())
            ]
        heapq.heapify(queue)
        while queue:
            _, offset, _, item = heapq.heappop(queue)
            if not isinstance(item, ChunkIndex):
                channel, message = item
                if (channels is None or channel.id in channels) and start <= message.log_time <= end:
                    yield channel, message
                continue
            for position, (channel, message) in enumerate(self._chunk(item)):
                if (channels is None or channel.id in channels) and start <= message.log_time <= end:
                    heapq.heappush(queue, (message.log_time, offset, position, (channel, message)))

    def _linear(self) -> Iterator[tuple[Channel, Message]]:
        self.stream.seek(0)
        reader = NonSeekingReader(self.stream, record_size_limit=self.size)
        for _, channel, message in reader.iter_messages(log_time_order=False):
            yield channel, message

    def _chunk(self, index: ChunkIndex) -> list[tuple[Channel, Message]]:
        offset = index.chunk_start_offset
        if index.chunk_length > self.size or not 0 < offset < self.size:
            raise BagError(
                f"{self.path}: chunk at byte {offset}: expected to end within the file, found {index.chunk_length}"
            )
        self.stream.seek(offset)
        records = StreamReader(self.stream, skip_magic=True, emit_chunks=True, record_size_limit=self.size).records
        chunk = next(records)
        if not isinstance(chunk, Chunk):
            raise BagError(f"{self.path}: byte {offset}: expected a chunk, found {type(chunk).__name__}")
        check_chunk(chunk)
        channels = self.summary.channels
        return [
            (channels[record.channel_id], record)
            for record in breakup_chunk(chunk, validate_crc=True)
            if isinstance(record, Message)
        ]

    def _check_ends(self) -> None:
        if self.size == 0:
            raise BagError(f"{self.path}: expected an MCAP file, found an empty file")
        first = self.stream.read(len(MAGIC))
        if first != MAGIC:
            raise BagError(f"{self.path}: expected an MCAP file, found one that begins with {first[:8].hex(' ')}")
        self.stream.seek(max(self.size - len(MAGIC), 0))
        if self.size < 2 * len(MAGIC) or self.stream.read() != MAGIC:
            found = readable_part(self.path)
            seconds = (found.end_ns - found.start_ns) / 1e9
            raise BagError(
                f"{self.path}: truncated MCAP: {found.num_messages} messages ({seconds:.1f} s) in {found.num_bytes} of"
                f" {self.size} bytes are readable and can be salvaged"
            )

    def _read_summary(self) -> Summary:
        self.stream.seek(0)
        reader = SeekingReader(self.stream, validate_crcs=True, record_size_limit=self.size)
        try:
            return reader.get_summary() or self._summary_by_scan()
        except ERRORS as error:
            raise BagError(f"{self.path}: damaged summary: {one_line(error)}") from None

    def _summary_by_scan(self) -> Summary:
        self.stream.seek(0)
        summary = Summary()
        for record in StreamReader(self.stream, record_size_limit=self.size).records:
            if isinstance(record, Channel):
                summary.channels[record.id] = record
            elif isinstance(record, Schema):
                summary.schemas[record.id] = record
        return summary


def check_chunk(chunk: Chunk) -> None:
    """Refuse a chunk whose size after decompression is absurd, or not what its record says."""
    size = chunk.uncompressed_size
    if size > MAX_CHUNK:
        raise BagError(f"chunk: expected at most {MAX_CHUNK} bytes, found {size}")
    if chunk.compression == "zstd":
        told = zstandard.frame_content_size(chunk.data)
        if told not in (size, -1):
            raise BagError(f"chunk: expected {size} bytes after decompression, found {told}")


def readable_part(path: Path) -> Readable:
    """Return how much of a damaged file is readable."""
    count, start, end, last, error = 0, 0, 0, 0, ""
    try:
        for message, place in salvaged_messages(path):
            start = min(start, message.log_time) if count else message.log_time
            end, count, last = max(end, message.log_time), count + 1, place
    except BagError as damage:
        error = str(damage)
    return Readable(count, start, end, last, error)


def salvaged_messages(
    path: Path, channels: dict[int, Channel] | None = None, schemas: dict[int, Schema] | None = None
) -> Iterator[tuple[Message, int]]:
    """Yield (message, byte after its chunk) of every whole chunk; a damaged one is left out.

    After the last one BagError says what the first damage was, if there was any. Channels and schemas met on the way
    are put into the dictionaries.
    """
    size, damage = path.stat().st_size, ""
    with path.open("rb") as stream:
        try:
            for record in StreamReader(stream, emit_chunks=True, record_size_limit=size).records:
                inner = [record]
                if isinstance(record, Chunk):
                    try:
                        check_chunk(record)
                        inner = breakup_chunk(record, validate_crc=True)
                    except ERRORS as error:
                        damage = damage or f"{path}: damaged before byte {stream.tell()} of {size}: {one_line(error)}"
                        continue
                for item in inner:
                    if isinstance(item, Message):
                        yield item, stream.tell()
                    elif isinstance(item, Channel) and channels is not None:
                        channels[item.id] = item
                    elif isinstance(item, Schema) and schemas is not None:
                        schemas[item.id] = item
        except ERRORS as error:
            damage = damage or f"{path}: damaged at byte {stream.tell()} of {size}: {one_line(error)}"
    if damage:
        raise BagError(damage)


def one_line(error: BaseException) -> str:
    """Return the text of an error without line breaks, or its name if it has none."""
    return " ".join(str(error).split()) or type(error).__name__


def _may_hold(index: ChunkIndex, channels: set[int] | None) -> bool:
    offsets = index.message_index_offsets
    return channels is None or not offsets or bool(channels & offsets.keys())
