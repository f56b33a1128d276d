"""One MCAP file as an untrusted input: sizes are checked before anything is allocated, checksums always."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mcap.records import Channel, ChunkIndex, Message
from mcap.summary import Summary

from sphere_nav.geometry.files.limits import LIMITS
from sphere_nav.geometry.files.untrusted import open_file
from sphere_nav.ros.bags.mcap_records import FOOTER, MAGIC, Loose, read_summary, record_at, records_at, scan
from sphere_nav.ros.bags.mcap_salvage import readable_part
from sphere_nav.ros.bags.recorded import BagError

MAX_HELD = 1 << 29  # bytes of messages that wait for their turn, where chunks overlap in time
OVERHEAD = 300  # bytes of memory of a message beside its data


class McapFile:
    """An MCAP file with its summary; BagError if it is none, or not complete.

    `damages` takes a line for each chunk that cannot be read, which is passed over then; without it that is a BagError.
    """

    def __init__(self, path: Path, damages: list[str] | None = None) -> None:
        self.path, self._damages = path, damages
        try:
            self.stream = open_file(path, "bag", LIMITS["bag"])
        except OSError as error:
            raise BagError(f"{path}: cannot be read: {error.strerror}") from None
        except ValueError as error:
            raise BagError(str(error)) from None
        self.size = self.stream.seek(0, 2)
        self._loose: list[Loose] = []
        try:
            self._check_ends()
            self.summary = self._read_summary()
        except BagError as error:
            self.stream.close()
            raise self._name(error) from None
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
            yield from self._sort(channels, *stamps)
        except BagError as error:
            raise self._name(error) from None

    def chunk(self, index: ChunkIndex) -> list[tuple[Channel, Message]]:
        """Return the messages of one chunk in the order of the file, not copied; BagError if it is damaged."""
        try:
            return list(self._chunk(index.chunk_start_offset, is_view=True))
        except BagError as error:
            raise self._name(error) from None

    def _sort(self, channels: set[int] | None, start: int, end: int) -> Iterator[tuple[Channel, Message]]:
        indexes = {index.chunk_start_offset: index for index in self.summary.chunk_indexes}
        queue: list[tuple[int, int, int, Any]] = [
            (index.message_start_time, offset, -1, index)
            for offset, index in indexes.items()
            if index.message_end_time >= start and index.message_start_time <= end and _may_hold(index, channels)
        ]
        queue += [(loose.log_time, loose.begin, 0, loose) for loose in self._loose if start <= loose.log_time <= end]
        heapq.heapify(queue)
        held = 0
        while queue:
            _, offset, _, item = heapq.heappop(queue)
            if isinstance(item, ChunkIndex):
                for place, (channel, message) in enumerate(self._readable(offset)):
                    if (channels is None or channel.id in channels) and start <= message.log_time <= end:
                        heapq.heappush(queue, (message.log_time, offset, place, (channel, message)))
                        held += len(message.data) + OVERHEAD
                    if held > MAX_HELD:
                        raise BagError(f"expected chunks in order of time, found {MAX_HELD} bytes that overlap")
                continue
            if isinstance(item, Loose):
                message = record_at(self.stream, item.begin, item.end)
                channel = self._channel(message)
            else:
                channel, message = item
                held -= len(message.data) + OVERHEAD
            if channels is None or channel.id in channels:
                yield channel, message

    def _readable(self, place: int) -> Iterator[tuple[Channel, Message]]:
        try:
            yield from self._chunk(place)
        except BagError as error:
            if self._damages is None:
                raise
            if (told := str(self._name(error))) not in self._damages:
                self._damages.append(told)

    def _chunk(self, place: int, *, is_view: bool = False) -> Iterator[tuple[Channel, Message]]:
        for record in records_at(self.stream, place, self.size, is_view=is_view):
            if isinstance(record, Message):
                yield self._channel(record), record

    def _channel(self, message: Message) -> Channel:
        channel = self.summary.channels.get(message.channel_id)
        if channel is None:
            raise BagError(f"message: expected a channel of the summary, found channel {message.channel_id}")
        return channel

    def _check_ends(self) -> None:
        if self.size == 0:
            raise BagError("expected an MCAP file, found an empty file")
        first = self._read(0, len(MAGIC))
        if first != MAGIC:
            raise BagError(f"expected an MCAP file, found one that begins with {first.hex(' ')}")
        if self.size < 2 * len(MAGIC) + FOOTER.size or self._read(self.size - len(MAGIC), len(MAGIC)) != MAGIC:
            found = readable_part(self.path)
            seconds = (found.end_ns - found.start_ns) / 1e9
            raise BagError(
                f"truncated MCAP: {found.num_messages} messages ({seconds:.1f} s) in {found.num_bytes} of"
                f" {self.size} bytes are readable and can be salvaged"
            )

    def _read(self, place: int, num_bytes: int) -> bytes:
        self.stream.seek(place)
        return self.stream.read(num_bytes)

    def _read_summary(self) -> Summary:
        summary = read_summary(self.stream, self.size)
        if summary is None or not (summary.chunk_indexes or _is_empty(summary)) or _lacks_channels(summary):
            summary, self._loose = scan(self.stream, self.size)  # some writers do without
        return summary

    def _name(self, error: BagError) -> BagError:
        text = str(error)
        return error if text.startswith(str(self.path)) else BagError(f"{self.path}: {text}")


def _is_empty(summary: Summary) -> bool:
    return summary.statistics is not None and summary.statistics.message_count == 0


def _lacks_channels(summary: Summary) -> bool:
    """Whether a writer has left channels or types where they were first used, and does not repeat them at the end."""
    counted = summary.statistics.channel_message_counts if summary.statistics is not None else {}
    kinds = {channel.schema_id for channel in summary.channels.values()} - {0}
    return bool(counted.keys() - summary.channels.keys() or kinds - summary.schemas.keys())


def _may_hold(index: ChunkIndex, channels: set[int] | None) -> bool:
    offsets = index.message_index_offsets
    return channels is None or not offsets or bool(channels & offsets.keys())
