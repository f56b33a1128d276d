"""Read a bag: a rosbag2 folder or a lone file; MCAP by ourselves, other storages through `foreign.py`."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

from sphere_nav.geometry.files.untrusted import MAX_FILE_BYTES, choice, load_yaml, read_text, required, short, told_at
from sphere_nav.ros.bags.kind import PlainView, compression_of, is_foreign, lone_file
from sphere_nav.ros.bags.mcap_file import MAX_CHUNK, McapFile
from sphere_nav.ros.bags.recorded import BagError, Recorded, TopicInfo
from sphere_nav.ros.bags.unpack import unpack
from sphere_nav.ros.bags.writer import absolute
from sphere_nav.ros.interfaces import from_bytes, message_class, type_hash, type_name


class BagReader:
    """An open bag. BagError, in one line: no such file, no bag, empty, truncated, damaged.

    with BagReader("drive") as bag:
        bag.require("image_raw", Image)
        for topic, stamp_ns, message in bag.messages(["image_raw", "camera_info"]):
            ...

    `damages` takes a line for each chunk of an MCAP file, and each message of a replay, that cannot be read; they are
    passed over then.
    """

    def __init__(self, path: str | Path, *, is_empty_allowed: bool = False, damages: list[str] | None = None) -> None:
        self.path, self.damages = Path(path), damages
        self.files: list[Any] = []  # of MCAP, or one ForeignBag
        self._view: PlainView | None = None  # where it is compressed
        self._is_packed = False  # each message by itself
        try:
            with self._named():
                self._open()
            if not is_empty_allowed and self.num_messages == 0:
                raise BagError(f"{self.path}: expected messages, found an empty bag")
        except BaseException:
            self.close()
            raise

    def _open(self) -> None:
        information = _information(self.path / "metadata.yaml")
        source = lone_file(self.path) if information is None else self.path
        if information is not None and (mode := compression_of(information)) != "none":
            self._view = PlainView(self.path, information)
            source, information, self._is_packed = self._view.path, self._view.description, mode == "message"
        if is_foreign(source, information):
            from sphere_nav.ros.bags.foreign import ForeignBag  # a quarter of a second, for bags of others alone

            self.files.append(ForeignBag(source))
        else:
            self.files += [McapFile(name, damages=self.damages) for name in _mcap_files(source, information)]
        self.topics: dict[str, TopicInfo] = {}
        for info in (info for file in self.files for info in file.topics.values()):
            self.topics.setdefault(info.name, replace(info, count=0)).count += info.count
            if not (info.name + info.type).isprintable():
                raise BagError(f"{self.path}: topic: expected a printable name and type, found {short(info.name)}")

    @contextmanager
    def _named(self) -> Iterator[None]:
        """Errors name the bag, not the folder that it was unpacked into."""
        try:
            yield
        except BagError as error:
            if self._view is None:
                raise
            raise BagError(str(error).replace(str(self._view.path), str(self.path))) from None

    @property
    def num_messages(self) -> int:
        """Number of all messages."""
        return sum(info.count for info in self.topics.values())

    @property
    def time_range(self) -> tuple[int, int]:
        """Time of the first and of the last message in ns; (0, 0) for an empty bag."""
        spans = [file.time_range for file in self.files if file.time_range]
        return min((first for first, _ in spans), default=0), max((last for _, last in spans), default=0)

    def require(self, topic: str, kind: type[Any] | None = None) -> TopicInfo:
        """Return a topic; BagError, naming those that are there, unless the bag has messages of that type on it."""
        info = self.topics.get(absolute(topic))
        if info is None or info.count == 0:
            found = ", ".join(f"{name} ({entry.type})" for name, entry in sorted(self.topics.items()) if entry.count)
            raise BagError(f"{self.path}: expected topic {absolute(topic)}, found {found or 'none'}")
        if kind is not None and info.type != type_name(kind):
            raise BagError(f"{self.path}: {info.name}: expected {type_name(kind)}, found {info.type}")
        return info

    def raw(
        self, topics: Iterable[str] | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[Recorded]:
        """Yield serialized messages in order of time; all topics, or those named."""
        names = None if topics is None else {absolute(topic) for topic in topics}
        streams = [file.raw(names, start_ns, end_ns) for file in self.files]
        found = heapq.merge(*streams, key=lambda item: item.stamp_ns)
        with self._named():
            yield from map(self._unpacked, found) if self._is_packed else found

    def messages(
        self, topics: Iterable[str] | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[Recorded]:
        """Yield messages in order of time; all topics, or those named."""
        kinds: dict[str, type[Any]] = {}
        for topic, stamp, data in self.raw(topics, start_ns, end_ns):
            if topic not in kinds:
                kinds[topic] = self._class_of(topic)
            yield Recorded(topic, stamp, self.decode(topic, data, kinds[topic]))

    def decode(self, topic: str, data: bytes, kind: type[Any]) -> Any:
        """Deserialize one message; BagError if the bytes are not of that type."""
        return deserialize(data, kind, f"{self.path}: {topic}")

    def close(self) -> None:
        """Close the files."""
        for file in self.files:
            file.close()
        if self._view is not None:
            self._view.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        self.close()

    def _class_of(self, topic: str) -> type[Any]:
        info = self.topics[topic]
        with told_at(f"{self.path}: {topic}", BagError):
            kind = message_class(info.type)
        installed = type_hash(info.type)
        if info.hash and installed and info.hash != installed:
            raise BagError(f"{self.path}: {topic}: {info.type}: expected definition {installed}, found {info.hash}")
        return kind

    def _unpacked(self, item: Recorded) -> Recorded:
        with told_at(f"{self.path}: {item.topic}", BagError):
            return item._replace(message=unpack(item.message, "zstd", MAX_CHUNK))


def deserialize(data: bytes, kind: type[Any], where: str) -> Any:
    """Deserialize one message; BagError if the bytes are not of that type."""
    with told_at(where, BagError):
        return from_bytes(data, kind)


def _mcap_files(path: Path, information: dict[str, Any] | None) -> list[Path]:
    if not path.exists():
        partial = path.with_name(path.name + ".partial")
        hint = f", found {partial} of an interrupted run" if partial.exists() else ", found none"
        raise BagError(f"{path}: expected a bag (a folder, or a file .mcap, .db3 or .bag){hint}")
    if path.is_file():
        return [path]
    if information is None:
        files = sorted(path.glob("*.mcap"))
    else:
        files = [path / Path(name).name for name in information["relative_file_paths"]]
    if not files:
        raise BagError(f"{path}: expected metadata.yaml or .mcap files, found neither")
    for file in files:
        if not file.is_file():
            raise BagError(f"{path / 'metadata.yaml'}: relative_file_paths: expected {file.name}, found no such file")
    return files


def _information(metadata: Path) -> dict[str, Any] | None:
    """Return what metadata.yaml says of a bag, checked as far as it is used; None where there is none."""
    if not metadata.is_file():
        return None
    try:
        text = read_text(metadata, "description of a bag", MAX_FILE_BYTES)
        found = required(load_yaml(metadata, text), f"{metadata}", ["rosbag2_bagfile_information"])
        fields = ["storage_identifier", "relative_file_paths"]
        information = required(found["rosbag2_bagfile_information"], f"{metadata}: rosbag2_bagfile_information", fields)
        choice(information["storage_identifier"], f"{metadata}: storage_identifier", ["mcap", "sqlite3"])
    except ValueError as error:
        raise BagError(str(error)) from None
    names = information["relative_file_paths"]
    if not isinstance(names, list) or not all(isinstance(name, str) and Path(name).name for name in names):
        raise BagError(f"{metadata}: relative_file_paths: expected names of files, found {short(names)}")
    return dict(information)
