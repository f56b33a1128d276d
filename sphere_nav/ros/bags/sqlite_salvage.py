"""What a damaged sqlite3 bag still holds: every row on a page that is whole, whatever of the tree above it is lost.

SQLite itself gives up at the first damage. Its file is pages of one size; rows lie in leaf pages, long ones go on in
chains of overflow pages (https://www.sqlite.org/fileformat2.html). Each row of rosbag2 is told by its columns.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from mcap.records import Channel, Message, Schema

from sphere_nav.geometry.files.limits import LIMITS
from sphere_nav.geometry.files.untrusted import open_file
from sphere_nav.ros.bags.foreign import MAX_TOPICS, MergedCopy, side_files
from sphere_nav.ros.bags.mcap_records import MAX_CHUNK
from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.bags.unpack import unpack
from sphere_nav.ros.interfaces import schema_text

MAGIC, ZSTD_MAGIC = b"SQLite format 3\x00", b"\x28\xb5\x2f\xfd"
HEADER, LEAF, LEAF_HEADER = 100, 0x0D, 8  # bytes of the file's header, type of a leaf page, bytes of its header
SIZES = {0: 0, 1: 1, 2: 2, 3: 3, 4: 4, 5: 6, 6: 8, 7: 8, 8: 0, 9: 0}  # serial type -> bytes; from 12 on by its number
FIRST_BLOB = 12  # serial type of an empty blob; odd ones are texts
DAMAGE = (LookupError, ValueError)


class _Row(NamedTuple):
    """Where a message is: its time in ns, its number, the page of its cell and the place of the cell there."""

    stamp_ns: int
    number: int
    page: int
    place: int


class SqliteSalvage:
    """The messages of a damaged database; `damages` are what was left out, one line each."""

    def __init__(self, path: Path) -> None:
        """A write-ahead log beside the database is merged in, where SQLite still can."""
        self.path, self.damages = path, list[str]()
        self._channels: dict[int, tuple[Channel, Schema]] = {}
        self._definitions: dict[str, tuple[str, str]] = {}

    def messages(self) -> Iterator[tuple[Channel, Schema, Message]]:
        """Yield every message that is whole, with its topic and type, in the order of time."""
        copy = None
        if side_files(self.path):
            with suppress(BagError):
                copy = MergedCopy(self.path, [self.path])
        try:
            with open_file(copy.path if copy else self.path, "bag", LIMITS["bag"]) as file:
                yield from self._read(file)
        except ValueError as error:
            raise BagError(str(error)) from None
        finally:
            if copy is not None:
                copy.close()

    def _read(self, file: BinaryIO) -> Iterator[tuple[Channel, Schema, Message]]:
        pages = _Pages(file, self.path)
        rows, num_lost = self._find_rows(pages), 0
        for row in rows:
            data = b""
            with suppress(*DAMAGE, BagError):
                data = pages.row(row.page, row.place)[1][3]
                data = unpack(data, "zstd", MAX_CHUNK) if data.startswith(ZSTD_MAGIC) else data
            channel, schema = self._channels.get(_topic_id(pages, row), (None, None))
            if channel is None or schema is None or not data:
                num_lost += 1
                continue
            yield channel, schema, Message(channel.id, row.stamp_ns, data, row.stamp_ns, 0)
        if num_lost:
            self.damages.append(f"{self.path}: {num_lost} of {len(rows)} messages: expected whole rows, found cut ones")

    def _find_rows(self, pages: _Pages) -> list[_Row]:
        """Return where messages are, by time; keep topics and definitions of types."""
        rows: dict[int, _Row] = {}
        topics: dict[int, list[Any]] = {}
        for page in range(pages.count):
            for place in pages.cells(page):
                with suppress(*DAMAGE):
                    number, values = pages.row(page, place, is_head=True)
                    kinds = [type(value) for value in values]
                    if kinds == [type(None), int, int, bytes] and values[2] >= 0:
                        rows.setdefault(number, _Row(values[2], number, page, place))
                    elif kinds[1:5] == [str] * 4:
                        values = pages.row(page, place)[1]
                        if not (values[1] + values[2]).isprintable():
                            continue
                        if values[1].startswith("/") and len(topics) < MAX_TOPICS:
                            topics[number] = values
                        else:
                            self._definitions[values[1]] = values[2], values[3]
        for number, (_, name, kind, encoding, profiles, *_) in topics.items():
            if encoding == "cdr" and kind:
                metadata = {"offered_qos_profiles": profiles}
                self._channels[number] = Channel(number, name, encoding, metadata, number), self._schema(number, kind)
        return sorted(rows.values())

    def _schema(self, number: int, kind: str) -> Schema:
        encoding, text = self._definitions.get(kind, ("ros2msg", ""))
        if not text:
            with suppress(ValueError):
                text = schema_text(kind)
        return Schema(id=number, data=text.encode(), encoding=encoding, name=kind)


def _topic_id(pages: _Pages, row: _Row) -> int:
    with suppress(*DAMAGE):
        return int(pages.row(row.page, row.place, is_head=True)[1][1])
    return -1


class _Pages:
    """A file of pages, read one by one; IndexError or ValueError for what is not whole."""

    def __init__(self, file: BinaryIO, path: Path) -> None:
        """BagError for a file of another kind."""
        self._file = file
        head = file.read(HEADER)
        self._size = int.from_bytes(head[16:18], "big") if len(head) == HEADER else 0
        self._size = 1 << 16 if self._size == 1 else self._size
        if not head.startswith(MAGIC) or self._size not in [1 << bits for bits in range(9, 17)]:
            raise BagError(f"{path}: expected an sqlite3 database, found bytes {head[:8].hex(' ') or 'none'}")
        self._usable = self._size - head[20]
        self.count = -(-file.seek(0, 2) // self._size)

    def page(self, number: int) -> bytes:
        """Return the bytes of a page, numbered from 0; the last one may be cut."""
        if not 0 <= number < self.count:
            raise IndexError(number)
        self._file.seek(number * self._size)
        return self._file.read(self._size)

    def cells(self, number: int) -> list[int]:
        """Return the places of the rows of a leaf page; none of other pages."""
        page, start = self.page(number), HEADER if number == 0 else 0
        if len(page) < start + LEAF_HEADER or page[start] != LEAF:
            return []
        count = int.from_bytes(page[start + 3 : start + 5], "big")
        first = start + LEAF_HEADER
        places = [int.from_bytes(page[k : k + 2], "big") for k in range(first, first + 2 * count, 2)]
        return [place for place in places if first < place < len(page)]

    def row(self, number: int, place: int, *, is_head: bool = False) -> tuple[int, list[Any]]:
        """Return number and values of a row; `is_head`: without what is on other pages (a blob or text is empty)."""
        page = self.page(number)
        length, place = _varint(page, place)
        row_id, place = _varint(page, place)
        if length > MAX_CHUNK:
            raise ValueError(length)
        here = self._local(length)
        payload = page[place : place + here]
        if len(payload) < here:
            raise IndexError(place)
        if here < length and not is_head:
            payload += self._overflow(int.from_bytes(page[place + here : place + here + 4], "big"), length - here)
        return row_id, _values(payload, is_head=is_head)

    def _local(self, length: int) -> int:
        """Return how many bytes of a row are in its leaf page."""
        least = (self._usable - 12) * 32 // 255 - 23
        if length <= self._usable - 35:
            return length
        wanted = least + (length - least) % (self._usable - 4)
        return wanted if wanted <= self._usable - 35 else least

    def _overflow(self, number: int, length: int) -> bytes:
        parts = []
        while length > 0:
            page = self.page(number - 1)
            part = page[4 : 4 + min(length, self._usable - 4)]
            if len(part) < min(length, self._usable - 4):
                raise IndexError(number)
            parts.append(part)
            length, number = length - len(part), int.from_bytes(page[:4], "big")
        return b"".join(parts)


def _varint(data: bytes, place: int) -> tuple[int, int]:
    """Return a number of one to nine bytes, and the place after it."""
    value = 0
    for index in range(9):
        byte = data[place + index]
        if index == 8:
            return value << 8 | byte, place + 9
        value = value << 7 | byte & 0x7F
        if byte < 0x80:
            return value, place + index + 1
    raise ValueError(place)


def _values(payload: bytes, *, is_head: bool) -> list[Any]:
    """Return the columns of a row: None, int, bytes or str; those that the head lacks are empty."""
    end, place = _varint(payload, 0)
    kinds = []
    while place < end:
        kind, place = _varint(payload, place)
        kinds.append(kind)
    values: list[Any] = []
    for kind in kinds:
        size = (kind - FIRST_BLOB) // 2 if kind >= FIRST_BLOB else SIZES[kind]
        part = payload[place : place + size]
        if len(part) < size and not (is_head and kind >= FIRST_BLOB):
            raise IndexError(place)
        place += size
        if kind >= FIRST_BLOB:
            values.append(part.decode() if kind % 2 and not is_head else "" if kind % 2 else b"" if is_head else part)
        else:
            values.append({0: None, 8: 0, 9: 1}.get(kind, int.from_bytes(part, "big", signed=True)))
    return values
