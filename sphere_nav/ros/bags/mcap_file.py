"""One MCAP file, read by `mcap`: sizes are bounded before anything is allocated, checksums are checked always."""

from __future__ import annotations

import heapq
import logging
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any, BinaryIO

from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, ChunkIndex, DataEnd, Message, Schema, Statistics
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.summary import Summary

from sphere_nav.geometry.files.limits import LIMITS
from sphere_nav.geometry.files.untrusted import open_file, printable, told_at
from sphere_nav.ros import qos
from sphere_nav.ros.bags.recorded import BagError, Recorded, TopicInfo
from sphere_nav.ros.bags.unpack import unpack

MAX_CHUNK = 1 << 28  # bytes of a record, packed or not; one message of a chunk is the least that is read at once
IN_CHUNK = -1  # place of a chunk among the messages at its beginning
MAGIC = b"\x89MCAP0\r\n"
FOOTER = struct.Struct("<BQQQI")  # opcode, length, start of the summary, start of its offsets, CRC


def open_bag(path: Path) -> BinaryIO:
    """Open a regular file; BagError in one line for none, and for what cannot be read."""
    try:
        return open_file(path, "bag", LIMITS["bag"])
    except OSError as error:
        raise BagError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise BagError(str(error)) from None


@contextmanager
def told(what: str, remedy: str = "") -> Iterator[None]:
    """Whatever a library raises about a damaged bag becomes BagError, in one line; an absurd size is a MemoryError."""
    try:
        yield
    except BagError:
        raise
    except Exception as error:
        text = printable(str(error)) or type(error).__name__
        raise BagError(f"expected {what}, found: {text[:200]}{remedy}") from None


def read_chunk(stream: BinaryIO, place: int) -> list[Any]:
    """Return messages and definitions of the chunk at a place; BagError where it is damaged, or none."""
    with told("a whole chunk"):
        chunk = next(_records(stream, place))
        if not isinstance(chunk, Chunk):
            raise BagError(f"expected a chunk, found {type(chunk).__name__}")
        return unpack_chunk(chunk)


def unpack_chunk(chunk: Chunk) -> list[Any]:
    """Return messages and definitions of a chunk; BagError where it is damaged, or larger than the limit."""
    if chunk.uncompressed_size > MAX_CHUNK:
        raise BagError(f"expected at most {MAX_CHUNK} bytes, found {chunk.uncompressed_size}")
    plain = unpack(chunk.data, chunk.compression, chunk.uncompressed_size)
    if len(plain) != chunk.uncompressed_size:
        raise BagError(f"expected {chunk.uncompressed_size} bytes after decompression, found {len(plain)}")
    with told("whole records"):
        return breakup_chunk(replace(chunk, compression="", data=plain), validate_crc=True)


def _records(stream: BinaryIO, place: int) -> Iterator[Any]:
    """Yield the records from a place on, chunks as they are."""
    stream.seek(place)
    reader = StreamReader(stream, skip_magic=True, emit_chunks=True, record_size_limit=MAX_CHUNK)
    return iter(reader.records)


class McapFile:
    """An MCAP file with its summary; BagError if it is none, or not complete.

    `damages` takes a line for each chunk that cannot be read, which is passed over then; without it that is a BagError.
    With `is_cut` a file without its end is read as far as it goes, too.
    """

    def __init__(self, path: Path, damages: list[str] | None = None, *, is_cut: bool = False) -> None:
        self.path, self._damages, self._is_cut = path, damages, is_cut
        self.stream = open_bag(path)
        self.size = self.stream.seek(0, 2)
        self._loose: list[tuple[int, int]] = []  # log time and place of messages outside of chunks
        try:
            with told_at(path, BagError):
                self.summary = self._read_summary()
                self._tell_unreadable()
        except BaseException:
            self.stream.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self.stream.close()

    @property
    def statistics(self) -> Statistics:
        """Numbers and times of the messages."""
        assert self.summary.statistics is not None  # of a file without it they are counted
        return self.summary.statistics

    @property
    def time_range(self) -> tuple[int, int] | None:
        """Time of the first and of the last message in ns, None for an empty file."""
        told = self.statistics
        return (told.message_start_time, told.message_end_time) if told.message_count else None

    @cached_property
    def topics(self) -> dict[str, TopicInfo]:
        """The topics that can be read, by name; of several channels the type of the first."""
        topics: dict[str, TopicInfo] = {}
        for channel in filter(is_readable, self.summary.channels.values()):
            schema, details = self.summary.schemas.get(channel.schema_id), channel.metadata
            offers, kind = qos.from_yaml(details.get("offered_qos_profiles", "")), schema.name if schema else ""
            info = TopicInfo(channel.topic, kind, 0, offers, details.get("topic_type_hash", ""))
            topics.setdefault(channel.topic, info).count += self.statistics.channel_message_counts.get(channel.id, 0)
        return topics

    def raw(self, names: set[str] | None, start_ns: int | None, end_ns: int | None) -> Iterator[Recorded]:
        """Yield the messages of topics, of all where `names` is None, in order of time."""
        channels = self.summary.channels.values()
        wanted = None if names is None else {channel.id for channel in channels if channel.topic in names}
        for channel, message in self.messages(wanted, start_ns, end_ns):
            yield Recorded(channel.topic, message.log_time, message.data)

    def messages(
        self, channels: set[int] | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[tuple[Channel, Message]]:
        """Yield the messages of some channels from `start_ns` to `end_ns`, both included, in order of log time."""
        readable = {channel.id for channel in self.summary.channels.values() if is_readable(channel)}
        if readable != set(self.summary.channels):
            channels = readable if channels is None else readable & channels
        stamps = (0 if start_ns is None else start_ns, 2**64 if end_ns is None else end_ns)
        with told_at(self.path, BagError):
            yield from self._sort(channels, *stamps)

    def _tell_unreadable(self) -> None:
        """Say once which topics are passed over; BagError where all are."""
        others = [channel for channel in self.summary.channels.values() if not is_readable(channel)]
        found = ", ".join(f"{channel.topic} ({channel.message_encoding})" for channel in others)
        if others and len(others) == len(self.summary.channels):
            raise BagError(f"expected topics of encoding cdr, found {found}")
        if others:
            tell_once(f"{self.path}: not readable, passed over: {found}: expected encoding cdr")

    def chunk(self, index: ChunkIndex) -> list[tuple[Channel, Message]]:
        """Return the messages of one chunk in the order of the file; BagError if it is damaged."""
        with told_at(self.path, BagError):
            return self._chunk(index.chunk_start_offset)

    def _sort(self, channels: set[int] | None, start: int, end: int) -> Iterator[tuple[Channel, Message]]:
        indexes = {index.chunk_start_offset: index for index in self.summary.chunk_indexes}
        queue: list[tuple[int, int, int, Any]] = [
            (index.message_start_time, offset, IN_CHUNK, None)
            for offset, index in indexes.items()
            if index.message_end_time >= start and index.message_start_time <= end and _may_hold(index, channels)
        ]
        queue += [(stamp, place, 0, None) for stamp, place in self._loose if start <= stamp <= end]
        heapq.heapify(queue)
        while queue:
            _, offset, place, item = heapq.heappop(queue)
            if item is not None:
                yield item
                continue
            found = self._readable(offset) if place == IN_CHUNK else [self._single(offset)]
            for number, (channel, message) in enumerate(found):
                if (channels is None or channel.id in channels) and start <= message.log_time <= end:
                    heapq.heappush(queue, (message.log_time, offset, number, (channel, message)))

    def _readable(self, place: int) -> list[tuple[Channel, Message]]:
        try:
            return self._chunk(place)
        except BagError as error:
            self._note(error)
            return []

    def _note(self, error: BagError) -> None:
        if self._damages is None:
            raise error
        if (line := f"{self.path}: {error}") not in self._damages:
            self._damages.append(line)

    def _chunk(self, place: int) -> list[tuple[Channel, Message]]:
        with told_at(f"chunk at byte {place}", BagError):
            records = read_chunk(self.stream, place)
        return [(self._channel(record), record) for record in records if isinstance(record, Message)]

    def _single(self, place: int) -> tuple[Channel, Message]:
        with told(f"a message at byte {place}"):
            message = next(_records(self.stream, place))
        return self._channel(message), message

    def _channel(self, message: Message) -> Channel:
        channel = self.summary.channels.get(message.channel_id)
        if channel is None:
            raise BagError(f"message: expected a channel of the summary, found channel {message.channel_id}")
        return channel

    def _read_summary(self) -> Summary:
        """Return the summary; of a file without, or without its end where that is no damage, what is in the file."""
        if self.size == 0:
            raise BagError("expected an MCAP file, found an empty file")
        first = self._read_at(0, len(MAGIC))
        if first != MAGIC and not self._is_cut:
            raise BagError(f"expected an MCAP file, found one that begins with {first.hex(' ')}")
        begin = self.size - len(MAGIC) - FOOTER.size
        if begin < len(MAGIC) or self._read_at(self.size - len(MAGIC), len(MAGIC)) != MAGIC:
            if self._is_cut:
                return self._scan()
            raise BagError("truncated MCAP: expected its end, found none: verify-bag --salvage saves what is readable")
        try:
            with told("a whole summary"):
                self._check_summary(begin)
                self.stream.seek(0)
                summary = SeekingReader(self.stream, record_size_limit=MAX_CHUNK).get_summary()
        except BagError as error:
            if self._is_cut:
                return self._scan()
            raise BagError(f"damaged summary: {error}") from None
        return summary if summary is not None and _is_complete(summary) else self._scan()  # some writers do without

    def _check_summary(self, begin: int) -> None:
        footer = self._read_at(begin, FOOTER.size)
        _, _, start, _, crc = FOOTER.unpack(footer)
        if (start and not len(MAGIC) <= start <= begin) or (begin - start > MAX_CHUNK and start):
            raise BagError(f"expected it before byte {begin}, found it at {start}")
        found = zlib.crc32(footer[:-4], zlib.crc32(self._read_at(start, begin - start))) if start and crc else crc
        if found != crc:
            raise BagError(f"checksum: expected {crc:08x}, found {found:08x}")

    def _scan(self) -> Summary:
        """Read the whole file; BagError where it is damaged, unless it is read as far as it goes."""
        summary, place = Summary(), len(MAGIC)
        summary.statistics = Statistics(0, 0, {}, 0, 0, 0, 0, 0, 0)
        try:
            with told(f"a whole record after byte {place}"):
                for record in _records(self.stream, place):
                    if isinstance(record, DataEnd):  # behind it a summary repeats what was told
                        break
                    begin, place = place, self.stream.tell()
                    if isinstance(record, Message):
                        self._loose.append((record.log_time, begin))
                    _add(summary, self._parts(record, begin, summary))
        except BagError as error:
            if not self._is_cut:
                raise
            self._note(error)
        return summary

    def _parts(self, record: Any, begin: int, summary: Summary) -> list[Any]:
        """Return what a record holds; a chunk is added to the index."""
        if not isinstance(record, Chunk):
            return [record]
        try:
            parts = unpack_chunk(record)
        except BagError as error:
            if not self._is_cut:
                raise BagError(f"chunk at byte {begin}: {error}") from None
            self._note(BagError(f"chunk at byte {begin}: {error}"))
            return []
        messages = [part for part in parts if isinstance(part, Message)]
        own, stamps = {message.channel_id: 0 for message in messages}, [message.log_time for message in messages]
        first, last = min(stamps, default=0), max(stamps, default=0)
        summary.chunk_indexes.append(ChunkIndex(0, begin, "", 0, last, 0, own, first, 0))
        return parts

    def _read_at(self, place: int, num_bytes: int) -> bytes:
        self.stream.seek(place)
        return self.stream.read(num_bytes)


def _add(summary: Summary, parts: list[Any]) -> None:
    statistics = summary.statistics
    assert statistics is not None
    for part in parts:
        if isinstance(part, Schema):
            summary.schemas[part.id] = part
        elif isinstance(part, Channel):
            summary.channels[part.id] = part
        elif isinstance(part, Message):
            counts, stamp, is_first = statistics.channel_message_counts, part.log_time, not statistics.message_count
            counts[part.channel_id] = counts.get(part.channel_id, 0) + 1
            statistics.message_count += 1
            statistics.message_start_time = stamp if is_first else min(statistics.message_start_time, stamp)
            statistics.message_end_time = max(statistics.message_end_time, stamp)


def _is_complete(summary: Summary) -> bool:
    """Whether messages, channels and types are all told; some writers leave them where they were first used."""
    if summary.statistics is None or (summary.statistics.message_count and not summary.chunk_indexes):
        return False
    counted, kinds = summary.statistics.channel_message_counts, {one.schema_id for one in summary.channels.values()}
    return counted.keys() <= summary.channels.keys() and kinds - {0} <= summary.schemas.keys()


def is_readable(channel: Channel) -> bool:
    """Whether its messages are those of ROS 2; bridges write JSON or protobuf beside them."""
    return bool(channel.message_encoding == "cdr")


@cache
def tell_once(text: str) -> None:
    """Say what is passed over of a file, however often it is opened."""
    logging.getLogger("sphere_nav.bag").warning(text)


def _may_hold(index: ChunkIndex, channels: set[int] | None) -> bool:
    offsets = index.message_index_offsets
    return channels is None or not offsets or bool(channels & offsets.keys())
