"""Bags that `rosbags` reads: sqlite3, MCAP without an index, what is compressed by file or message, and ROS 1.

What ROS 1 recorded becomes the ROS 2 message of the same name: the header loses its `seq`.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rclpy.qos import QoSProfile
from rosbags.convert.converter import migrate_bytes
from rosbags.interfaces import Connection, QosDurability
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag2 import Reader as Ros2Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from sphere_nav.geometry.files.untrusted import told_at
from sphere_nav.ros import qos
from sphere_nav.ros.bags.mcap_file import open_bag, told
from sphere_nav.ros.bags.recorded import ROS1, SALVAGE, SQLITE, BagError, Recorded, TopicInfo
from sphere_nav.ros.bags.writer import absolute

RENAMED = {"tf/msg/tfMessage": "tf2_msgs/msg/TFMessage"}
STORED = (SQLITE, ".mcap", ".zstd")  # ends of the names of files with messages
ADDRESS = set("%?#")  # of a URI, by which the library asks SQLite: the wrong database would be opened, or none
SIDE_FILES = ("-wal", "-journal")  # of SQLite: what is not yet, or not to be, in the database


class ForeignBag:
    """An open bag: its topics, and its messages as CDR of ROS 2. BagError, in one line, for what cannot be read."""

    def __init__(self, path: Path) -> None:
        self._path, self._opened = path, ExitStack()
        self._migrations: dict[str, object] = {}  # what the library keeps of each kind
        try:
            self._open(path)
            with self._told():
                self.topics: dict[str, TopicInfo] = {}
                for one in self._reader.connections:
                    name, kind = absolute(one.topic), RENAMED.get(one.msgtype, one.msgtype)
                    known = self.topics.setdefault(name, TopicInfo(name, kind, 0, _profile(one), ""))
                    known.count += int(one.msgcount)
                self._types = _types_of(self._reader.connections) if path.suffix == ROS1 else []
        except BaseException:
            self.close()
            raise

    def _open(self, path: Path) -> None:
        files = [file for file in path.iterdir() if file.suffix in STORED] if path.is_dir() else [path]
        for file in files:
            _check_file(file)
        reader = Ros1Reader if path.suffix == ROS1 else Ros2Reader
        self._remedy = f"; {SALVAGE}" if any(file.suffix == SQLITE for file in files) else ""
        if self._remedy and set(os.fspath(path.resolve())) & ADDRESS:
            folder = self._opened.enter_context(TemporaryDirectory(prefix="sphere_nav_"))
            link = Path(folder, "bag" if path.is_dir() else f"bag{SQLITE}")  # which means nothing in an address
            link.symlink_to(path.resolve())
            path = link
        with self._told():
            self._reader: Any = self._opened.enter_context(reader(path))

    @property
    def time_range(self) -> tuple[int, int] | None:
        """Time of the first and of the last message in ns, None for an empty bag."""
        if not self._reader.message_count:
            return None
        with self._told():
            return int(self._reader.start_time), int(self._reader.end_time) - 1

    def raw(self, names: set[str] | None, start_ns: int | None, end_ns: int | None) -> Iterator[Recorded]:
        """Yield the messages of topics, of all where `names` is None, in order of time."""
        wanted = [c for c in self._reader.connections if names is None or absolute(c.topic) in names]
        if not wanted:
            return
        stop = None if end_ns is None else end_ns + 1
        with self._told():
            for connection, stamp_ns, data in self._reader.messages(wanted, start=start_ns, stop=stop):
                plain = bytes(memoryview(data))  # TypeError where a database has something else there
                if self._types:
                    (source, target), kind = self._types, connection.msgtype
                    to = source, target, kind, RENAMED.get(kind, kind), self._migrations
                    plain = bytes(migrate_bytes(*to, plain, src_is2=False, dst_is2=True))
                yield Recorded(absolute(connection.topic), int(stamp_ns), plain)

    def close(self) -> None:
        """Close the files."""
        self._opened.close()

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Whatever the library raises about a damaged bag becomes BagError."""
        with told_at(self._path, BagError), told("a readable bag", self._remedy):
            yield


def _types_of(connections: list[Connection]) -> list[Any]:
    """Return the types of ROS 1 and of ROS 2, also those that the bag alone defines, such as tf2_msgs/TFMessage."""
    stores = [get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_JAZZY)]
    for connection in connections:
        for name, definition in get_types_from_msg(connection.msgdef.data, connection.msgtype).items():
            for store in stores:
                if name not in store.fielddefs:
                    store.register({name: definition})
    return stores


def _profile(connection: Connection) -> QoSProfile:
    """Return how a topic was offered, as far as it matters: whether its last message holds for who comes later."""
    offered = getattr(connection.ext, "offered_qos_profiles", ())
    is_latched = bool(getattr(connection.ext, "latching", 0)) or absolute(connection.topic) == "/tf_static"
    is_latched |= any(profile.durability is QosDurability.TRANSIENT_LOCAL for profile in offered)
    return qos.LATCHED if is_latched else qos.STATE


def _check_file(file: Path) -> None:
    """Refuse a pipe or a device, which a library would wait for, and a database of which a part lies beside it."""
    with open_bag(file) as stream:
        if not stream.read(1):
            raise BagError(f"{file}: expected a bag, found an empty file")
    for beside in (file.with_name(f"{file.name}{end}") for end in SIDE_FILES):
        if beside.exists() and beside.stat().st_size:
            remedy = f"sqlite3 {file.name} 'PRAGMA wal_checkpoint(TRUNCATE)' merges it"
            raise BagError(f"{file}: expected a whole database, found {beside.name} beside it: {remedy}")
