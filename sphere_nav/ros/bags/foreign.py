"""Bags in other storages than MCAP, read by `rosbags`: sqlite3 and ROS 1.

What ROS 1 recorded becomes the ROS 2 message of the same name: the header loses its `seq`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
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

from sphere_nav.geometry.files.untrusted import told_at
from sphere_nav.ros import qos
from sphere_nav.ros.bags.kind import ROS1, SALVAGE, SQLITE
from sphere_nav.ros.bags.mcap_file import MAX_CHUNK, open_bag, told
from sphere_nav.ros.bags.recorded import BagError, Recorded, TopicInfo
from sphere_nav.ros.bags.unpack import unpack

RENAMED = {"tf/msg/tfMessage": "tf2_msgs/msg/TFMessage"}
SIDE_FILES = ("-wal", "-journal")  # of SQLite: what is not yet, or not to be, in the database


class ForeignBag:
    """An open bag: its topics, and its messages as CDR of ROS 2. BagError, in one line, for what cannot be read."""

    def __init__(self, path: Path) -> None:
        self._path, self._is_open = path, False
        self._link: TemporaryDirectory[str] | None = None
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
            _check_file(file)
        reader = Ros1Reader if path.suffix == ROS1 else Ros2Reader
        plain = self._plain_path(path)
        self._reader: Any = self._guard(lambda: reader(plain))
        self._guard(self._reader.open)
        self._is_open = True
        if path.suffix == ROS1:
            chunks = self._reader.chunks
            self._reader.chunks = {place: _bound_chunk(chunk) for place, chunk in chunks.items()}

    def _plain_path(self, path: Path) -> Path:
        """Return a path without what has a meaning in a URI, which the library asks SQLite with."""
        if not set(os.fspath(path.resolve())) & set("%?#"):
            return path
        self._link = TemporaryDirectory(prefix="sphere_nav_")
        plain = Path(self._link.name) / f"bag{path.suffix if path.is_file() else ''}"
        plain.symlink_to(path.resolve())
        return plain

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
            stamp_ns, data = self._guard(partial(_plain, stamp_ns, data))
            if len(data) > MAX_CHUNK:
                raise BagError(
                    f"{self._path}: {connection.topic}: expected at most {MAX_CHUNK} bytes, found {len(data)}"
                )
            if self._path.suffix == ROS1:
                data = self._guard(partial(self._convert, connection.msgtype, data))
            yield Recorded(_topic_of(connection), stamp_ns, data)

    def close(self) -> None:
        """Close the files."""
        if self._is_open:
            self._reader.close()
            self._is_open = False
        if self._link is not None:
            self._link.cleanup()

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
        with told_at(self._path, BagError), told("a readable bag", "" if self._path.suffix == ROS1 else f"; {SALVAGE}"):
            return call()


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


def _plain(stamp_ns: Any, data: Any) -> tuple[int, bytes]:
    """Return time and bytes of a message; TypeError or ValueError where a database has something else there."""
    return int(stamp_ns), bytes(memoryview(data))


def _check_file(file: Path) -> None:
    """Refuse a pipe or a device, which a library would wait for, and a database of which a part lies beside it."""
    with open_bag(file) as stream:
        if not stream.read(1):
            raise BagError(f"{file}: expected a bag, found an empty file")
    for beside in (file.with_name(f"{file.name}{end}") for end in SIDE_FILES):
        if beside.exists() and beside.stat().st_size:
            remedy = f"sqlite3 {file.name} 'PRAGMA wal_checkpoint(TRUNCATE)' merges it"
            raise BagError(f"{file}: expected a whole database, found {beside.name} beside it: {remedy}")
