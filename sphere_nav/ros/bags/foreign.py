"""Bags in other storages than MCAP, read by `rosbags`: sqlite3 and ROS 1.

A database with a write-ahead log or a journal beside it, as a crash leaves it, is read from a temporary copy into which
SQLite has merged that; the bag itself is never written to.
What ROS 1 recorded becomes the ROS 2 message of the same name: the header loses its `seq`.
"""

from __future__ import annotations

import io
import os
import shutil
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rclpy.qos import QoSProfile
from rosbags.convert.converter import migrate_bytes
from rosbags.interfaces import Connection, QosDurability
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag1.reader import decompressors as ROS1_METHODS
from rosbags.rosbag2 import Reader as Ros2Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from sphere_nav.geometry.files.limits import LIMITS
from sphere_nav.geometry.files.untrusted import open_file
from sphere_nav.ros import qos
from sphere_nav.ros.bags.kind import ROS1, SALVAGE, SQLITE
from sphere_nav.ros.bags.mcap_records import MAX_CHUNK
from sphere_nav.ros.bags.recorded import BagError, Recorded, TopicInfo
from sphere_nav.ros.bags.unpack import FREE_SHARE, unpack

RENAMED = {"tf/msg/tfMessage": "tf2_msgs/msg/TFMessage"}
SIDE_FILES = ("-wal", "-journal")  # of SQLite: what is not yet, or not to be, in the database
MAX_TOPICS = 10_000


class ForeignBag:
    """An open bag: its topics, and its messages as CDR of ROS 2. BagError, in one line, for what cannot be read."""

    def __init__(self, path: Path) -> None:
        self._path, self._is_open = path, False
        self._merged: MergedCopy | None = None
        try:
            self._open(path)
            self.topics = self._guard(self._read_topics)
            self._convert = _Converter(self._reader.connections)
        except BaseException:
            self.close()
            raise

    def _open(self, path: Path) -> None:
        files = sorted(path.glob(f"*{SQLITE}")) if path.is_dir() else [path] * (path.suffix == SQLITE)
        for file in files or [path] * (path.suffix == ROS1):
            self._guard(partial(_check_regular, file))
        if any(side_files(file) for file in files):
            self._merged = MergedCopy(path, files)
            path, files = self._merged.path, self._merged.files
        for file in files:
            self._guard(partial(_check_sqlite, file))
        reader = Ros1Reader if path.suffix == ROS1 else Ros2Reader
        self._reader: Any = self._guard(lambda: reader(_BoundedPath(path)))
        self._guard(self._reader.open)
        self._is_open = True
        if path.suffix == ROS1:
            chunks = self._reader.chunks
            self._reader.chunks = {place: _bound_chunk(chunk) for place, chunk in chunks.items()}

    @property
    def time_range(self) -> tuple[int, int] | None:
        """Time of the first and of the last message in ns, None for an empty bag."""
        if not self._reader.message_count:
            return None
        first, end = self._guard(lambda: (int(self._reader.start_time), int(self._reader.end_time)))
        return first, end - 1

    def raw(self, names: set[str] | None, start_ns: int | None, end_ns: int | None) -> Iterator[Recorded]:
        """Yield the messages of topics, of all where `names` is None, in order of time."""
        wanted = [c for c in self._reader.connections if names is None or _topic_of(c) in names]
        if not wanted:
            return
        stop = None if end_ns is None else end_ns + 1
        messages = self._guard(lambda: self._reader.messages(wanted, start=start_ns, stop=stop))
        while True:
            found = self._guard(lambda: next(messages, None))
            if found is None:
                return
            connection, stamp_ns, data = found
            if len(data) > MAX_CHUNK:
                raise BagError(
                    f"{self._path}: {connection.topic}: expected at most {MAX_CHUNK} bytes, found {len(data)}"
                )
            if self._path.suffix == ROS1:
                data = self._guard(partial(self._convert, connection.msgtype, data))
            yield Recorded(_topic_of(connection), int(stamp_ns), bytes(data))

    def close(self) -> None:
        """Close the files."""
        if self._is_open:
            self._reader.close()
            self._is_open = False
        if self._merged is not None:
            self._merged.close()

    def _read_topics(self) -> dict[str, TopicInfo]:
        topics: dict[str, TopicInfo] = {}
        for connection in self._reader.connections:
            name = _topic_of(connection)
            kind = RENAMED.get(connection.msgtype, connection.msgtype)
            known = topics.setdefault(name, TopicInfo(name, kind, 0, _profiles(connection), ""))
            known.count += int(connection.msgcount)
        return topics

    def _guard(self, call: Callable[[], Any]) -> Any:
        """Return what a call into the library returns; whatever it raises about a damaged bag becomes BagError."""
        try:
            return call()
        except (MemoryError, KeyboardInterrupt):
            raise
        except Exception as error:
            text = " ".join(str(error).split()) or type(error).__name__
            if self._merged is not None:
                text = text.replace(self._merged.folder, str(self._path if self._path.is_dir() else self._path.parent))
            if isinstance(error, BagError) and text.startswith(str(self._path)):
                raise BagError(text) from None
            raise BagError(f"{self._path}: expected a readable bag, found: {text[:200]}") from None


class _BoundedFile(io.BufferedReader):
    """A file that never asks for memory beyond its end, whatever size is written in it."""

    def read(self, size: int | None = -1, /) -> bytes:
        """Return up to `size` bytes, all where it is negative."""
        if size is not None and size > io.DEFAULT_BUFFER_SIZE:
            size = max(0, min(size, os.fstat(self.fileno()).st_size - self.tell()))
        return super().read(size)


class _BoundedPath(type(Path())):  # type: ignore[misc]  # PosixPath: the library opens what it is given by `open`
    """A path that opens bounded files."""

    def open(self, mode: str = "r", *args: Any, **options: Any) -> Any:
        """Open as Path does."""
        return _BoundedFile(io.FileIO(self)) if mode == "rb" else super().open(mode, *args, **options)


def _bound_chunk(chunk: Any) -> Any:
    """Return a chunk of a ROS 1 bag that is not unpacked beyond the limit."""
    name = next(name for name, method in ROS1_METHODS.items() if method is chunk.decompressor)
    return chunk._replace(decompressor=lambda data: unpack(data, "" if name == "none" else name, MAX_CHUNK))


class _Converter:
    """Messages of ROS 1 as CDR of the ROS 2 message of the same name; types of others are those the bag defines."""

    def __init__(self, connections: list[Connection]) -> None:
        self._cache: dict[str, object] = {}
        self._connections, self._stores = connections, list[Any]()

    def __call__(self, kind: str, data: bytes) -> bytes:
        if not self._stores:
            self._stores = [get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_JAZZY)]
            self._define()
        source, target = self._stores
        name = RENAMED.get(kind, kind)
        return bytes(migrate_bytes(source, target, kind, name, self._cache, data, src_is2=False, dst_is2=True))

    def _define(self) -> None:
        """Add the definitions in the bag of types that the libraries do not know, such as tf2_msgs/TFMessage."""
        for connection in self._connections:
            for name, definition in get_types_from_msg(connection.msgdef.data, connection.msgtype).items():
                for store in self._stores:
                    if name not in store.fielddefs:
                        store.register({name: definition})


def _topic_of(connection: Connection) -> str:
    return "/" + connection.topic.lstrip("/")


def _profiles(connection: Connection) -> list[QoSProfile]:
    """Return how a topic was offered, as far as it matters: whether its last message holds for who comes later."""
    offered = getattr(connection.ext, "offered_qos_profiles", ())
    is_latched = bool(getattr(connection.ext, "latching", 0)) or _topic_of(connection) == "/tf_static"
    is_latched |= any(profile.durability is QosDurability.TRANSIENT_LOCAL for profile in offered)
    return [qos.LATCHED] if is_latched else []


def _check_regular(file: Path) -> None:
    """Refuse a pipe or a device, which a library would wait for."""
    try:
        open_file(file, "bag", LIMITS["bag"]).close()
        if not file.stat().st_size:  # also a file of /proc, which may have no end
            raise ValueError(f"{file}: expected a bag, found an empty file")
    except ValueError as error:
        raise BagError(str(error)) from None


def side_files(database: Path) -> list[Path]:
    """Return the log and the journal beside a database, where they hold anything."""
    beside = [database.with_name(f"{database.name}{end}") for end in SIDE_FILES]
    return [file for file in beside if file.exists() and file.stat().st_size]


class MergedCopy:
    """A temporary copy of a bag: its databases with what lies beside them merged in, links to all else."""

    def __init__(self, path: Path, databases: list[Path]) -> None:
        """Raise BagError where there is no room for the copy, or where the bag is being written."""
        self._folder = TemporaryDirectory(prefix="sphere_nav_")
        self.folder = self._folder.name
        folder = Path(self.folder)
        try:
            self.files = [self._merge(file, folder) if side_files(file) else self._link(file) for file in databases]
            if path.is_dir() and (path / "metadata.yaml").is_file():
                self._link(path / "metadata.yaml")
        except BaseException as error:
            self.close()
            if isinstance(error, (OSError, ValueError, sqlite3.Error)) and not isinstance(error, BagError):
                text = " ".join(str(error).split())[:200]
                raise BagError(f"{path}: expected a database whose log can be merged, found: {text}") from None
            raise
        self.path = folder if path.is_dir() else self.files[0]

    def _link(self, file: Path) -> Path:
        link = Path(self.folder, file.name)
        link.symlink_to(file.resolve())
        return link

    def _merge(self, file: Path, folder: Path) -> Path:
        sources = [file, *side_files(file)]
        before = [(source.stat().st_size, source.stat().st_mtime_ns) for source in sources]
        total, free = sum(size for size, _ in before), shutil.disk_usage(folder).free
        if total > FREE_SHARE * free:
            names = ", ".join(source.name for source in sources[1:])
            expected = f"{total} bytes free in {folder.parent} for a copy into which {names} is merged"
            remedy = f"merge it in place: sqlite3 {file.name} 'PRAGMA wal_checkpoint(TRUNCATE)'"
            raise BagError(f"{file}: expected {expected}, found {free}; set TMPDIR, or {remedy}")
        for source in sources:
            with open_file(source, "database", LIMITS["bag"]) as read, (folder / source.name).open("wb") as written:
                shutil.copyfileobj(read, written, 1 << 20)
        if before != [(source.stat().st_size, source.stat().st_mtime_ns) for source in sources]:
            raise BagError(f"{file}: expected a bag that is complete, found one that is being written")
        with closing(sqlite3.connect(folder / file.name)) as database:
            database.execute("PRAGMA trusted_schema=OFF")
            database.execute("PRAGMA journal_mode=DELETE").fetchone()
        return folder / file.name

    def close(self) -> None:
        """Remove it."""
        self._folder.cleanup()


def _check_sqlite(path: Path) -> None:
    """Refuse what a recorder does not write, before anything is allocated.

    A view may compute without end, a column may be generated, a topic may be there many times, a message absurd.
    """
    odd = "typeof(data) <> 'blob' OR typeof(timestamp) <> 'integer' OR typeof(topic_id) <> 'integer'"
    try:
        with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)) as database:
            database.execute("PRAGMA trusted_schema=OFF")
            _check_tables(path, database)
            largest, num_odd = database.execute(f"SELECT max(length(data)), sum({odd}) FROM messages").fetchone()
            num_topics, num_ids = database.execute("SELECT count(*), count(DISTINCT id) FROM topics").fetchone()
    except (sqlite3.Error, OSError) as error:
        raise BagError(f"{path}: expected a rosbag2 database, found: {error}; {SALVAGE}") from None
    if largest is not None and int(largest) > MAX_CHUNK:
        raise BagError(f"{path}: expected messages of at most {MAX_CHUNK} bytes, found one of {largest}")
    if num_odd:
        raise BagError(f"{path}: expected messages of bytes with a stamp and a topic, found {num_odd} others")
    if num_topics != num_ids or num_topics > MAX_TOPICS:
        raise BagError(f"{path}: expected up to {MAX_TOPICS} topics, found {num_topics} with {num_ids} ids")


def _check_tables(path: Path, database: sqlite3.Connection) -> None:
    tables = []
    for kind, name, text in database.execute("SELECT type, name, sql FROM sqlite_master").fetchall():
        is_virtual = "virtual" in str(text).lower().split("(")[0]
        if kind not in ("table", "index") or is_virtual:
            raise BagError(f"{path}: expected tables alone, found the {'virtual ' * is_virtual}{kind} {name!r}")
        tables += [name] * (kind == "table")
    for name in tables:
        columns = database.execute("SELECT name, hidden FROM pragma_table_xinfo(?)", (name,)).fetchall()
        if hidden := [column for column, is_hidden in columns if is_hidden]:
            raise BagError(f"{path}: {name}: expected columns that are stored, found {hidden[0]!r}")
