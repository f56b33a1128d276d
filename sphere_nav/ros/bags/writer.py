"""Write a rosbag2 bag: a folder with one MCAP file and metadata.yaml (version 9)."""

from __future__ import annotations

import os
import shlex
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from copy import deepcopy
from itertools import count
from pathlib import Path
from typing import Any, BinaryIO, Self

import yaml
from mcap.records import Schema
from mcap.writer import CompressionType, Writer
from rclpy.qos import QoSProfile

from sphere_nav.ros import qos
from sphere_nav.ros.bags.recorded import BagError, TopicInfo, serialize_to_store
from sphere_nav.ros.interfaces import schema_text, type_hash, type_name

CHUNK_SIZE = 1 << 20  # bytes before compression
DISTRIBUTION = "jazzy"
PARTIAL = ".partial"
METADATA = "metadata.yaml"


class BagWriter:
    """A bag being written; it is called `path` only when it is complete.

    Until `close` it is the folder `<path>.partial`: a killed process leaves that behind, readable by `salvage`. Nothing
    is overwritten. As a context manager it closes at the end of the block and discards everything on an exception.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        file_name: str = "",
        chunk_size: int = CHUNK_SIZE,
        is_compressed: bool = True,
        suffix: str = PARTIAL,
    ) -> None:
        self.path = Path(path)
        self.partial = self.path.with_name(self.path.name + suffix)
        if os.path.lexists(self.path):
            raise BagError(f"{self.path}: expected no such file or folder, found one: nothing is overwritten")
        if os.path.lexists(self.partial):
            what = "a run that is still writing, or the remains of one"
            raise BagError(f"{self.partial}: {what}: '{self.salvage_command}' rescues them, or delete it")
        self.partial.mkdir(parents=True)
        self.file_name = file_name or f"{self.path.name}_0.mcap"
        self._file: BinaryIO = (self.partial / self.file_name).open("wb")
        compression = CompressionType.ZSTD if is_compressed else CompressionType.NONE
        self._mcap = Writer(self._file, chunk_size=chunk_size, compression=compression, enable_crcs=True)
        self._mcap.start(profile="ros2", library="sphere_nav")
        self._topics: dict[str, TopicInfo] = {}
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._span: tuple[int, int] | None = None  # from the first stamp to the last
        self._is_open = True

    def add_topic(
        self, topic: str, kind: type[Any] | str, profile: QoSProfile = qos.STATE, *, schema: Schema | None = None
    ) -> None:
        """Declare a topic (made absolute), its type and the QoS that its publishers offer.

        `schema`: the definition where the type may not be installed here.
        """
        name = absolute(topic)
        kind_name = kind if isinstance(kind, str) else type_name(kind)
        if name in self._topics:
            if self._topics[name].type != kind_name:
                raise BagError(f"{self.path}: {name}: expected {self._topics[name].type}, found {kind_name}")
            return
        if kind_name not in self._schemas:
            encoding, text = (schema.encoding, schema.data) if schema else ("ros2msg", schema_text(kind_name).encode())
            self._schemas[kind_name] = self._mcap.register_schema(kind_name, encoding, text)
        self._topics[name] = info = TopicInfo(name, kind_name, 0, profile, type_hash(kind_name))
        details = {"offered_qos_profiles": qos.to_yaml(profile), "topic_type_hash": info.hash}
        self._channels[name] = self._mcap.register_channel(name, "cdr", self._schemas[kind_name], details)

    def write(self, topic: str, message: Any, stamp: int) -> None:
        """Write a message; `stamp` is when it was received, in ns, and what orders a replay."""
        self.add_topic(topic, type(message))
        self.write_bytes(topic, serialize_to_store(message), stamp)

    def write_bytes(self, topic: str, data: bytes, stamp: int, *, published: int | None = None) -> None:
        """Write a serialized message on a topic that `add_topic` declared."""
        entry = self._topics[absolute(topic)]
        sent, (first, last) = stamp if published is None else published, self._span or (stamp, stamp)
        with self._naming_the_file():
            self._mcap.add_message(self._channels[entry.name], stamp, data, sent, entry.count)
        entry.count, self._span = entry.count + 1, (min(first, stamp), max(last, stamp))

    def flush(self) -> None:
        """Hand everything written so far to the operating system; the next message begins a new chunk."""
        with self._naming_the_file():
            self._mcap.flush()

    @property
    def position(self) -> int:
        """Bytes of the file so far; where the next chunk begins after `flush`."""
        return self._file.tell()

    @property
    def num_messages(self) -> int:
        """Messages written so far."""
        return sum(entry.count for entry in self._topics.values())

    def close(self) -> Path:
        """Complete the bag and give it its name; return its path."""
        if self._is_open:
            with self._naming_the_file():
                self._finish()
            self.partial.rename(self.path)
            self._is_open = False
        return self.path

    @property
    def salvage_command(self) -> str:
        """The command that makes a bag of what is whole where `close` was not reached."""
        return shlex.join(["sphere_nav", "verify-bag", str(self.partial), "--salvage", str(self.path)])

    def _finish(self) -> None:
        text = yaml.safe_dump({"rosbag2_bagfile_information": self._description()}, sort_keys=False)
        self._mcap.finish()
        _sync_and_close(self._file)
        with (self.partial / METADATA).open("wb") as metadata:
            metadata.write(text.encode())
            _sync_and_close(metadata)

    @contextmanager
    def _naming_the_file(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:  # of a write, which does not say where
            error.filename = error.filename or str(self.partial / self.file_name)
            raise

    def discard(self) -> None:
        """Remove what was written, unless it is complete or left."""
        if self._is_open:
            self.leave()
            shutil.rmtree(self.partial, ignore_errors=True)

    def leave(self) -> None:
        """Write no more; what was written stays, for `salvage`."""
        self._is_open = False
        with suppress(OSError):  # of a full disk, which has been told
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        try:
            if kind is None:
                self.close()
        finally:
            self.discard()

    def _description(self) -> dict[str, Any]:
        first, last = self._span or (0, 0)
        topics = []
        for entry in self._topics.values():
            description = {
                "name": entry.name,
                "type": entry.type,
                "serialization_format": "cdr",
                "offered_qos_profiles": [qos.to_entry(entry.profile)],
                "type_description_hash": entry.hash,
            }
            topics.append({"topic_metadata": description, "message_count": entry.count})
        extent = {
            "duration": {"nanoseconds": last - first},
            "starting_time": {"nanoseconds_since_epoch": first},
            "message_count": self.num_messages,
        }
        return {
            "version": 9,
            "storage_identifier": "mcap",
            **extent,
            "topics_with_message_count": topics,
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [self.file_name],
            "files": [{"path": self.file_name, **deepcopy(extent)}],  # else YAML would refer to the first
            "custom_data": None,
            "ros_distro": DISTRIBUTION,
        }


def absolute(topic: str) -> str:
    """Return the name with a leading slash, as bags have them."""
    return topic if topic.startswith("/") else f"/{topic}"


def free_path(first: Path) -> Path:
    """Return the path, or the first of `<path>_2`, `<path>_3`, ... at which there is no bag and no partial one."""
    paths = (first if number == 1 else first.with_name(f"{first.name}_{number}") for number in count(1))
    return next(p for p in paths if not os.path.lexists(p) and not os.path.lexists(p.with_name(p.name + PARTIAL)))


def _sync_and_close(file: BinaryIO | Any) -> None:
    file.flush()
    os.fsync(file.fileno())
    file.close()
