"""What a damaged MCAP file still holds.

Where its index is whole: every chunk that the damage did not hit. Without an index, as after a crash: all up to the
first record that does not fit, which is the last whole chunk.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from mcap.opcode import Opcode
from mcap.records import Channel, Message, Schema
from mcap.summary import Summary

from sphere_nav.geometry.files.limits import LIMITS
from sphere_nav.geometry.files.untrusted import open_file
from sphere_nav.ros.bags.mcap_records import Record, read_summary, record_at, records_at, walk
from sphere_nav.ros.bags.recorded import BagError

LOOSE = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)  # what is read outside of chunks, in a file without


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
        self._summary = Summary()

    def messages(self) -> Iterator[tuple[Channel, Schema, Message]]:
        """Yield every message that is whole, with its channel and its type, in the order of the file."""
        try:
            file = open_file(self.path, "bag", LIMITS["bag"])
        except ValueError as error:
            raise BagError(str(error)) from None
        with file as stream:
            size = stream.seek(0, 2)
            for opcode, begin, end in self._places(stream, size):
                self.place = end
                try:
                    if opcode == Opcode.CHUNK:
                        yield from self._of(records_at(stream, begin, size))
                    else:
                        yield from self._of([record_at(stream, begin, end)])
                except BagError as error:
                    self._note(str(error))

    def _places(self, stream: BinaryIO, size: int) -> Iterator[tuple[int, int, int]]:
        """Yield opcode, begin and end of the chunks of the index; without one, of what lies before the first damage."""
        try:
            self._summary = read_summary(stream, size) or self._summary
        except BagError as error:
            self._note(str(error))
        indexes = self._summary.chunk_indexes
        if indexes:
            spans = {(index.chunk_start_offset, index.chunk_start_offset + index.chunk_length) for index in indexes}
            yield from ((Opcode.CHUNK, begin, end) for begin, end in sorted(spans))
            return
        is_chunked = False
        try:
            for opcode, begin, end in walk(stream, size):
                is_chunked |= opcode == Opcode.CHUNK
                if opcode == Opcode.CHUNK or (not is_chunked and opcode in LOOSE):
                    yield opcode, begin, end
        except BagError as error:
            self._note(str(error))

    def _of(self, records: Iterable[Record]) -> Iterator[tuple[Channel, Schema, Message]]:
        schemas, channels = self._summary.schemas, self._summary.channels
        for record in records:
            if isinstance(record, Channel):
                channels.setdefault(record.id, record)
            elif isinstance(record, Schema):
                schemas.setdefault(record.id, record)
            elif isinstance(record, Message):
                channel = channels.get(record.channel_id)
                schema = None if channel is None else schemas.get(channel.schema_id)
                if channel is None or schema is None:
                    self._note(f"a message of channel {record.channel_id}, whose definition is lost")
                else:
                    yield channel, schema, record

    def _note(self, damage: str) -> None:
        self.damages.append(f"{self.path}: {damage}")
