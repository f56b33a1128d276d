"""One MCAP file, read by `mcap`: what that raises about a damaged file is one line; what is whole of one is found."""

from __future__ import annotations

import logging
import struct
import zlib
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager, suppress
from functools import cache, cached_property
from itertools import takewhile
from pathlib import Path
from typing import Any, BinaryIO

import zstandard
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, DataEnd, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.summary import Summary

from sphere_nav.geometry.files.untrusted import LIMITS, open_file, printable, told_at
from sphere_nav.ros import qos
from sphere_nav.ros.bags.recorded import BagError, Recorded, TopicInfo

MAX_CHUNK = 1 << 28  # bytes of a record; one message of a chunk is the least that is read at once
MAGIC = b"\x89MCAP0\r\n"
FOOTER = struct.Struct("<BQQQI")  # opcode, length, start of the summary, start of its offsets, CRC
SALVAGE = ": verify-bag --salvage saves what is readable"


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


class McapFile:
    """An MCAP file with its summary; BagError if it is none, or was cut. Its messages are found where it is indexed."""

    def __init__(self, path: Path) -> None:
        self.path, self.stream = path, open_bag(path)
        try:
            with told_at(path, BagError):
                if (begin := self.stream.read(len(MAGIC))) != MAGIC:
                    found = "one of another kind" if begin else "an empty file"
                    raise BagError(f"expected an MCAP file, found {found}")
                self.stream.seek(0)
                with told("an MCAP file"):
                    self._reader = SeekingReader(self.stream, validate_crcs=True, record_size_limit=MAX_CHUNK)
                self._check_end()
                with told("a whole summary"):
                    summary = self._reader.get_summary()
                self.summary = summary or Summary()
                self._tell_unreadable()
        except BaseException:
            self.stream.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self.stream.close()

    @property
    def is_indexed(self) -> bool:
        """Whether messages, channels and types are all told; some writers leave them where they were first used."""
        told = self.summary.statistics
        if told is None or (told.message_count and not self.summary.chunk_indexes):
            return False
        kinds = {one.schema_id for one in self.summary.channels.values()} - {0}
        counted = told.channel_message_counts.keys()
        return counted <= self.summary.channels.keys() and kinds <= self.summary.schemas.keys()

    @property
    def time_range(self) -> tuple[int, int] | None:
        """Time of the first and of the last message in ns, None for an empty file."""
        told = self.summary.statistics
        return (told.message_start_time, told.message_end_time) if told and told.message_count else None

    @cached_property
    def topics(self) -> dict[str, TopicInfo]:
        """The topics that can be read, by name; of several channels the type of the first."""
        topics: dict[str, TopicInfo] = {}
        counts = self.summary.statistics.channel_message_counts if self.summary.statistics else {}
        for channel in filter(is_readable, self.summary.channels.values()):
            schema, details = self.summary.schemas.get(channel.schema_id), channel.metadata
            profile, kind = qos.from_yaml(details.get("offered_qos_profiles", "")), schema.name if schema else ""
            info = TopicInfo(channel.topic, kind, 0, profile, details.get("topic_type_hash", ""))
            topics.setdefault(channel.topic, info).count += counts.get(channel.id, 0)
        return topics

    def raw(self, names: set[str] | None, start_ns: int | None, end_ns: int | None) -> Iterator[Recorded]:
        """Yield the messages of topics, of all where `names` is None, in order of time; both bounds are included."""
        with told_at(self.path, BagError), told("whole chunks", SALVAGE):
            for _, channel, message in self._reader.iter_messages(names, starting_at=start_ns, ending_at=end_ns):
                if is_readable(channel):
                    yield Recorded(channel.topic, message.log_time, message.data)

    def _tell_unreadable(self) -> None:
        """Say once which topics are passed over; BagError where all are."""
        others = [channel for channel in self.summary.channels.values() if not is_readable(channel)]
        found = ", ".join(f"{channel.topic} ({channel.message_encoding})" for channel in others)
        if others and len(others) == len(self.summary.channels):
            raise BagError(f"expected topics of encoding cdr, found {found}")
        if others:
            tell_once(f"{self.path}: not readable, passed over: {found}: expected encoding cdr")

    def _check_end(self) -> None:
        """Raise BagError for a file that was cut, or a summary that is not what was written; `mcap` asks neither."""
        end = self.stream.seek(0, 2) - len(MAGIC)
        begin = end - FOOTER.size
        if begin < len(MAGIC) or self._read_at(end, len(MAGIC)) != MAGIC:
            raise BagError(f"truncated MCAP: expected its end, found none{SALVAGE}")
        footer = self._read_at(begin, FOOTER.size)
        _, _, start, _, crc = FOOTER.unpack(footer)
        if start and not max(len(MAGIC), begin - MAX_CHUNK) <= start <= begin:
            raise BagError(f"damaged summary: expected it before byte {begin}, found it at {start}")
        if start and crc and crc != zlib.crc32(footer[:-4], zlib.crc32(self._read_at(start, begin - start))):
            raise BagError(f"damaged summary: checksum: expected {crc:08x}, found another one")

    def _read_at(self, place: int, num_bytes: int) -> bytes:
        self.stream.seek(place)
        return self.stream.read(num_bytes)


def read_chunk(stream: BinaryIO, place: int) -> list[Any]:
    """Return messages and definitions of the chunk at a place; BagError where it is damaged, or none."""
    with told("a whole chunk"):
        stream.seek(place)
        record = next(_records(stream))
        if not isinstance(record, Chunk):
            raise BagError(f"expected a chunk, found {type(record).__name__}")
        return _parts(record)


def read_message(stream: BinaryIO, place: int) -> memoryview:
    """Return the bytes of the one message in the chunk at a place; BagError for a damaged chunk, or one of several."""
    found = [part.data for part in read_chunk(stream, place) if isinstance(part, Message)]
    if len(found) != 1:
        raise BagError(f"expected one message, found {len(found)}")
    return memoryview(found[0])


def whole_messages(path: Path) -> Iterator[tuple[Schema, Channel, Message]]:
    """Yield what is whole of a file that may be damaged or cut, chunk by chunk: by its index, or as far as it goes."""
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    places: list[int] = []
    with suppress(BagError), closing(McapFile(path)) as file:
        schemas, channels = file.summary.schemas, file.summary.channels
        places = sorted(index.chunk_start_offset for index in file.summary.chunk_indexes)
    with open_bag(path) as stream:
        for part in _whole_chunks(stream, places) if places else _walk(stream):
            if isinstance(part, Schema):
                schemas[part.id] = part
            elif isinstance(part, Channel):
                channels[part.id] = part
            elif isinstance(part, Message):
                channel = channels.get(part.channel_id)
                if channel is not None and is_readable(channel) and channel.schema_id in schemas:
                    yield schemas[channel.schema_id], channel, part


def _whole_chunks(stream: BinaryIO, places: Iterable[int]) -> Iterator[Any]:
    for place in places:
        with suppress(BagError):
            yield from read_chunk(stream, place)


def _walk(stream: BinaryIO) -> Iterator[Any]:
    """Yield what is in a file from its beginning up to the first record that is none, or what repeats it at the end."""
    stream.seek(len(MAGIC))
    with suppress(BagError), told("a whole record"):
        for record in takewhile(lambda record: not isinstance(record, DataEnd), _records(stream)):
            with suppress(BagError), told("a whole chunk"):
                yield from _parts(record)


def _records(stream: BinaryIO) -> Iterator[Any]:
    """Yield the records from here on, chunks as they are."""
    return iter(StreamReader(stream, skip_magic=True, emit_chunks=True, record_size_limit=MAX_CHUNK).records)


def _parts(record: Any) -> list[Any]:
    """Return what a record holds; BagError for a chunk that would take more than the limit."""
    if not isinstance(record, Chunk):
        return [record]
    is_zstd = record.compression == "zstd"
    size = max(record.uncompressed_size, zstandard.frame_content_size(record.data) if is_zstd else 0)
    if size > MAX_CHUNK:
        raise BagError(f"expected at most {MAX_CHUNK} bytes, found {size}")
    return breakup_chunk(record, validate_crc=True)


def is_readable(channel: Channel) -> bool:
    """Whether its messages are those of ROS 2; bridges write JSON or protobuf beside them."""
    return bool(channel.message_encoding == "cdr")


@cache
def tell_once(text: str) -> None:
    """Say what is passed over of a file, however often it is opened."""
    logging.getLogger("sphere_nav.bag").warning(text)
