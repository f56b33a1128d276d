"""What a damaged MCAP file still holds: everything but what the damage hit.

Schemas and channels come from the summary where its checksum is right, for the chunk that defined them may be the
damaged one. Chunks are found by walking from record to record; where a record's own sizes do not fit, a chunk is taken
for what most of its fields say it is, and beyond that the next one is searched by its shape. What counts in the end is
the checksum of its records.
"""

from __future__ import annotations

import mmap
import re
import zlib
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

from mcap.opcode import Opcode
from mcap.records import Channel, Message, Schema

from sphere_nav.geometry.files.text_file import open_file
from sphere_nav.ros.bags.mcap_chunk import CHUNK_HEAD, MAX_CHUNK, PREFIX, ChunkRecord, parsed
from sphere_nav.ros.bags.mcap_summary import MAGIC, read_summary
from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.bags.unpack import unpack

MAX_FILE = 1 << 50
COMPRESSIONS = (b"zstd", b"lz4", b"")
MAGICS = {b"zstd": b"\x28\xb5\x2f\xfd", b"lz4": b"\x04\x22\x4d\x18"}
BODY = rb".{5}\x00{3}.{16}.{5}\x00{3}.{4}(?:\x04\x00{3}zstd|\x03\x00{3}lz4|\x00{4})"
"""Length, two times, a size, the checksum and the name of a compression, as a chunk begins behind its opcode."""
SHAPE, SHAPE_BUT_OPCODE = re.compile(rb"\x06" + BODY, re.DOTALL), re.compile(rb"." + BODY, re.DOTALL)


class Readable(NamedTuple):
    """How much of a truncated or damaged file is readable."""

    num_messages: int
    start_ns: int
    end_ns: int
    num_bytes: int
    error: str


def readable_part(path: Path) -> Readable:
    """Return how much of a damaged file is readable."""
    count, start, end, last, salvage = 0, 0, 0, 0, Salvage(path)
    for _, _, message in salvage.messages():
        start = min(start, message.log_time) if count else message.log_time
        end, count, last = max(end, message.log_time), count + 1, salvage.place
    return Readable(count, start, end, last, salvage.damages[0] if salvage.damages else "")


class Salvage:
    """The messages of a damaged file, and in `damages`, one line each, what was left out."""

    def __init__(self, path: Path) -> None:
        """OSError where there is no such file."""
        self.path = path
        self.damages: list[str] = []
        self.place = 0  # byte after the record that the last message was in
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}

    def messages(self) -> Iterator[tuple[Channel, Schema, Message]]:
        """Yield every message that is whole, with its channel and its type, in the order of the file."""
        try:
            file = open_file(self.path, "bag", MAX_FILE)
        except ValueError as error:
            raise BagError(str(error)) from None
        with file as stream:
            if stream.seek(0, 2) == 0:
                return
            with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
                self._read_definitions(stream, len(data))
                for plain in self._records(data):
                    yield from self._messages_of(plain)

    def _messages_of(self, plain: bytes) -> Iterator[tuple[Channel, Schema, Message]]:
        try:
            for record in parsed(plain):
                if isinstance(record, Channel):
                    self._channels.setdefault(record.id, record)
                elif isinstance(record, Schema):
                    self._schemas.setdefault(record.id, record)
                elif isinstance(record, Message):
                    channel = self._channels.get(record.channel_id)
                    schema = None if channel is None else self._schemas.get(channel.schema_id)
                    if channel is None or schema is None:
                        self._note(f"a message of channel {record.channel_id}, whose definition is lost")
                    else:
                        yield channel, schema, record
        except BagError as error:
            self._note(str(error))

    def _read_definitions(self, stream: Any, size: int) -> None:
        try:
            summary = read_summary(stream, size)
        except BagError as error:
            self._note(str(error))
            return
        if summary is not None:
            self._schemas, self._channels = summary.schemas, summary.channels

    def _records(self, data: mmap.mmap) -> Iterator[bytes]:
        """Yield the records of every chunk; of a file without chunks, every record of a message or definition."""
        place, is_chunked = len(MAGIC), SHAPE.search(data) is not None
        while place + PREFIX.size <= len(data):
            opcode, length = PREFIX.unpack_from(data, place)
            end = place + PREFIX.size + length
            is_record = _is_plain(opcode) and end <= len(data)
            is_record = is_record and (_begins_a_record(data, end) or find_chunk(data, end) is not None)
            chunk = find_chunk(data, place) if not is_record or SHAPE_BUT_OPCODE.match(data, place) else None
            if chunk is not None:
                self.place = place = chunk.end
                yield from self._verify(data, chunk)
            elif opcode == Opcode.DATA_END and length == 4:
                return
            elif is_record:
                if not is_chunked and opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
                    self.place = end
                    yield bytes(data[place:end])
                place = end
            else:
                self._note(f"byte {place}: expected a record, found {opcode} of {length} bytes")
                found = SHAPE.search(data, place + 1)
                place = found.start() if found else len(data)

    def _verify(self, data: mmap.mmap, chunk: ChunkRecord) -> Iterator[bytes]:
        try:
            plain = unpack(bytes(data[chunk.data_begin : chunk.end]), chunk.compression, MAX_CHUNK)
        except BagError as error:
            self._note(f"chunk at byte {chunk.begin}: {error}")
            return
        if len(plain) > MAX_CHUNK:
            self._note(f"chunk at byte {chunk.begin}: expected at most {MAX_CHUNK} bytes, found more")
            return
        wrong = (zlib.crc32(plain) ^ chunk.crc).bit_count() if chunk.crc else 0
        if wrong > 1:  # no single flip in the records changes a single bit of their checksum: that flip was in itself
            self._note(f"chunk at byte {chunk.begin}: checksum: expected {chunk.crc:08x}, found another")
            return
        yield plain

    def _note(self, damage: str) -> None:
        self.damages.append(f"{self.path}: {damage}")


def find_chunk(data: Any, place: int) -> ChunkRecord | None:
    """Return the chunk that begins at a place by most of its fields, though one of them may be damaged."""
    head_begin = place + PREFIX.size
    if head_begin + CHUNK_HEAD.size + 8 > len(data):
        return None
    opcode, length = PREFIX.unpack_from(data, place)
    start_ns, end_ns, plain_size, crc, name_size = CHUNK_HEAD.unpack_from(data, head_begin)
    best: tuple[int, ChunkRecord] | None = None
    for name, is_by_length in product(COMPRESSIONS, (False, True)):
        name_begin = head_begin + CHUNK_HEAD.size
        data_begin = name_begin + len(name) + 8
        told = int.from_bytes(data[data_begin - 8 : data_begin], "little")
        size = head_begin + length - data_begin if is_by_length else told
        if not 0 <= size <= min(len(data) - data_begin, MAX_CHUNK):
            continue
        votes = [
            opcode == Opcode.CHUNK,
            name_size == len(name),
            data_begin + told == head_begin + length,
            _begins_a_record(data, data_begin + size),
        ]
        if name:
            votes += [data[name_begin : name_begin + len(name)] == name, _has_magic(data, data_begin, name)]
        else:
            votes.append(plain_size == size)
        missing = len(votes) - sum(votes)
        if missing <= 1 and (best is None or missing < best[0]):
            method = name.decode()
            chunk = ChunkRecord(place, data_begin + size, start_ns, end_ns, plain_size, crc, method, data_begin)
            best = missing, chunk
    return best[1] if best else None


def _has_magic(data: Any, place: int, name: bytes) -> bool:
    return bytes(data[place : place + 4]) == MAGICS[name]


def _begins_a_record(data: Any, place: int) -> bool:
    """Whether a record begins here, by its opcode and length, or the file was cut."""
    if place + PREFIX.size > len(data):
        return True
    opcode, length = PREFIX.unpack_from(data, place)
    return (_is_plain(opcode) or opcode == Opcode.CHUNK) and place + PREFIX.size + length <= len(data)


def _is_plain(opcode: int) -> bool:
    """Whether this is the opcode of a record other than a chunk."""
    return 0 < opcode <= Opcode.DATA_END and opcode != Opcode.CHUNK
