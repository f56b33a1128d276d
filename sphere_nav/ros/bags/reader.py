"""Read a bag: a rosbag2 folder or a lone file; MCAP by `mcap`, all else by `rosbags`."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

from sphere_nav.geometry.files.untrusted import MAX_FILE_BYTES, load_yaml, read_as, read_text, required, short, told_at
from sphere_nav.ros.bags.mcap_file import McapFile
from sphere_nav.ros.bags.recorded import ROS1, SQLITE, BagError, Recorded, TopicInfo
from sphere_nav.ros.bags.writer import METADATA, PARTIAL, absolute
from sphere_nav.ros.interfaces import from_bytes, message_class, type_hash, type_name

KEY = "rosbag2_bagfile_information"


class BagReader:
    """An open bag. BagError, in one line: no such file, no bag, empty, truncated, damaged.

    with BagReader("drive") as bag:
        bag.require("image_raw", Image)
        for topic, stamp_ns, message in bag.messages(["image_raw", "camera_info"]):
            ...
    """

    def __init__(self, path: str | Path, *, is_empty_allowed: bool = False) -> None:
        self.path = Path(path)
        self.files: list[Any] = []  # McapFile or ForeignBag
        try:
            self._open()
            if not is_empty_allowed and self.num_messages == 0:
                raise BagError(f"{self.path}: expected messages, found an empty bag")
        except BaseException:
            self.close()
            raise

    def _open(self) -> None:
        told = _information(self.path / METADATA)
        if told is not None and (told.compression_mode or "none").lower() != "none":
            self.files.append(_foreign(self.path))
        else:
            self.files += map(_open_file, _stored(self.path, told))
        self.topics: dict[str, TopicInfo] = {}
        for info in (info for file in self.files for info in file.topics.values()):
            self.topics.setdefault(info.name, replace(info, count=0)).count += info.count
            if not (info.name + info.type).isprintable():
                raise BagError(f"{self.path}: topic: expected a printable name and type, found {short(info.name)}")

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
        yield from heapq.merge(*streams, key=lambda item: item.stamp_ns)

    def messages(self, topics: Iterable[str] | None = None, end_ns: int | None = None) -> Iterator[Recorded]:
        """Yield messages in order of time; all topics, or those named."""
        kinds: dict[str, type[Any]] = {}
        for topic, stamp, data in self.raw(topics, end_ns=end_ns):
            if topic not in kinds:
                kinds[topic] = self._class_of(topic)
            yield Recorded(topic, stamp, self.decode(topic, data, kinds[topic]))

    def decode(self, topic: str, data: bytes, kind: type[Any]) -> Any:
        """Deserialize one message; BagError if the bytes are not of that type."""
        with told_at(f"{self.path}: {topic}", BagError):
            return from_bytes(data, kind)

    def close(self) -> None:
        """Close the files."""
        for file in self.files:
            file.close()

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


@dataclass(frozen=True)
class _Information:
    """What metadata.yaml says of a bag, as far as it is used."""

    relative_file_paths: tuple[str, ...]
    compression_mode: str | None = None


def _information(metadata: Path) -> _Information | None:
    """Return what metadata.yaml says of a bag; None where there is none."""
    if not metadata.is_file():
        return None
    with told_at(metadata, BagError):
        found = required(load_yaml("YAML", read_text(metadata, "description of a bag", MAX_FILE_BYTES)), "YAML", [KEY])
        information: _Information = read_as(_Information, found[KEY], KEY)
    return information


def _stored(path: Path, information: _Information | None) -> list[Path]:
    """Return the files with the messages of a bag."""
    if not path.exists():
        partial = path.with_name(path.name + PARTIAL)
        hint = f", found {partial} of an interrupted run" if partial.exists() else ", found none"
        raise BagError(f"{path}: expected a bag (a folder, or a file .mcap, .db3 or .bag){hint}")
    if not path.is_dir():
        return [path]
    if information is None:
        files = sorted(file for file in path.iterdir() if file.suffix in (".mcap", SQLITE, ROS1))
    else:
        files = [path / Path(name).name for name in information.relative_file_paths]
    if not files:
        raise BagError(f"{path}: expected {METADATA}, .mcap, .db3 or .bag files, found none of them")
    for file in files:
        if not file.is_file():
            raise BagError(f"{path / METADATA}: relative_file_paths: expected {file.name}, found no such file")
    return files


def _open_file(path: Path) -> Any:
    """Return the open file, by `mcap` where it is MCAP with an index."""
    if path.suffix not in (SQLITE, ROS1):
        file = McapFile(path)
        if file.is_indexed:
            return file
        file.close()
    return _foreign(path)


def _foreign(path: Path) -> Any:
    from sphere_nav.ros.bags.foreign import ForeignBag  # a quarter of a second, for bags of others alone

    return ForeignBag(path)
