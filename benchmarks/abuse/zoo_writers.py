"""Recordings written by the libraries of others: rosbags (ROS 1, sqlite3, MCAP) and mcap, none of our own code."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from numpy.typing import NDArray
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

Item = tuple[str, str, int, Any]  # topic, type, time of recording in ns, message
TF = "tf2_msgs/msg/TFMessage"
OLD_TF = "tf/msg/tfMessage"  # of ROS 1 before tf2
DEFINITIONS = {
    TF: "geometry_msgs/TransformStamped[] transforms",
    OLD_TF: "geometry_msgs/TransformStamped[] transforms",
    "acme_msgs/msg/Battery": "std_msgs/Header header\nfloat32 volts\nacme_msgs/Cell[] cells",
    "acme_msgs/msg/Cell": "float32 volts",
}


@dataclass
class Messages:
    """Makes messages of one generation of ROS."""

    is_ros1: bool = False

    def __post_init__(self) -> None:
        self.store = get_typestore(Stores.ROS1_NOETIC if self.is_ros1 else Stores.ROS2_JAZZY)
        for name, text in DEFINITIONS.items():
            for found, fields in get_types_from_msg(text, name).items():
                if found not in self.store.fielddefs:
                    self.store.register({found: fields})
        self.types = self.store.types

    def make(self, name: str, *fields: Any) -> Any:
        """Return a message of a type, fields in order."""
        return self.types[name](*fields)

    def header(self, ns: int, frame: str) -> Any:
        """Return a header, which counts in ROS 1."""
        time = self.make("builtin_interfaces/msg/Time", ns // 10**9, ns % 10**9)
        return self.make("std_msgs/msg/Header", *((0,) if self.is_ros1 else ()), time, frame)

    def image(self, pixels: NDArray[Any], ns: int, frame: str, encoding: str, *, padding: int = 0) -> Any:
        """Return an Image; `padding` bytes after each row."""
        rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(len(pixels), -1)
        rows = np.pad(rows, ((0, 0), (0, padding)))
        is_big = int(pixels.dtype.byteorder == ">")
        shape = pixels.shape[0], pixels.shape[1]
        fields = self.header(ns, frame), *shape, encoding, is_big, rows.shape[1], rows.ravel()
        return self.make("sensor_msgs/msg/Image", *fields)

    def compressed(self, data: bytes, ns: int, frame: str, format_: str) -> Any:
        """Return a CompressedImage."""
        return self.make(
            "sensor_msgs/msg/CompressedImage", self.header(ns, frame), format_, np.frombuffer(data, np.uint8)
        )

    def info(
        self,
        size: tuple[int, int],
        focal: float,
        ns: int,
        frame: str,
        *,
        model: str = "plumb_bob",
        baseline: float = 0.0,
        has_k: bool = True,
    ) -> Any:
        """Return a CameraInfo of a size (width, height) whose principal point is its middle."""
        width, height = size
        cx, cy = width / 2 - 0.5, height / 2 - 0.5
        K = np.array([focal, 0, cx, 0, focal, cy, 0, 0, 1]) * has_k
        P = np.array([focal, 0, cx, -focal * baseline, 0, focal, cy, 0, 0, 0, 1, 0])
        roi = self.make("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False)
        fields = height, width, model, np.zeros(5), K, np.eye(3).ravel(), P, 0, 0, roi
        return self.make("sensor_msgs/msg/CameraInfo", self.header(ns, frame), *fields)

    def transforms(self, edges: Iterable[tuple[NDArray[Any], str, str]], ns: int, kind: str = TF) -> Any:
        """Return a TFMessage of edges: x, y, z and quaternion (7,), parent, child."""
        found = []
        for values, parent, child in edges:
            place = self.make("geometry_msgs/msg/Vector3", *map(float, values[:3]))
            turn = self.make("geometry_msgs/msg/Quaternion", *map(float, values[3:]))
            pose = self.make("geometry_msgs/msg/Transform", place, turn)
            found.append(self.make("geometry_msgs/msg/TransformStamped", self.header(ns, parent), child, pose))
        return self.make(kind, found)

    def odometry(self, values: NDArray[Any], ns: int, frame: str = "odom") -> Any:
        """Return an Odometry of x, y, z and quaternion (7,) that stands still."""
        point = self.make("geometry_msgs/msg/Point", *map(float, values[:3]))
        pose = self.make(
            "geometry_msgs/msg/Pose", point, self.make("geometry_msgs/msg/Quaternion", *map(float, values[3:]))
        )
        zero = self.make("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
        spread = np.diag([1e-4] * 6).ravel()
        place = self.make("geometry_msgs/msg/PoseWithCovariance", pose, spread)
        twist = self.make(
            "geometry_msgs/msg/TwistWithCovariance", self.make("geometry_msgs/msg/Twist", zero, zero), spread
        )
        return self.make("nav_msgs/msg/Odometry", self.header(ns, frame), "base_link", place, twist)


Write = Callable[[Path, Messages, Iterable[Item]], Path]  # a path without ending -> the bag that was written there


def _write_all(writer: Any, store: Any, serialize: Any, items: Iterable[Item]) -> None:
    """Write messages by a writer of rosbags, each topic with a connection of its own."""
    known: dict[str, Any] = {}
    for topic, kind, ns, message in items:
        if topic not in known:
            known[topic] = writer.add_connection(topic, kind, typestore=store)
        writer.write(known[topic], ns, serialize(message, kind))


def ros2(storage: str = "mcap", mode: str = "", *, is_lone: bool = False) -> Write:
    """Return a writer of rosbag2 folders by rosbags; `mode`: file or message, that is compressed."""

    def write(path: Path, make: Messages, items: Iterable[Item]) -> Path:
        plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
        writer = Ros2Writer(path, version=9, storage_plugin=plugin)
        if mode:
            writer.set_compression(CompressionMode[mode.upper()], CompressionFormat.ZSTD)
        with writer:
            _write_all(writer, make.store, make.store.serialize_cdr, items)
        return next(file for file in path.iterdir() if file.suffix in (".db3", ".mcap")) if is_lone else path

    return write


def ros1(compression: str = "") -> Write:
    """Return a writer of ROS 1 bags by rosbags."""

    def write(path: Path, make: Messages, items: Iterable[Item]) -> Path:
        path = path.with_suffix(".bag")
        writer = Ros1Writer(path)
        if compression:
            writer.set_compression(Ros1Writer.CompressionFormat[compression.upper()])
        with writer:
            _write_all(writer, make.store, make.store.serialize_ros1, items)
        return path

    return write


def mcap(compression: CompressionType = CompressionType.ZSTD, **options: Any) -> Write:
    """Return a writer of .mcap files by mcap."""

    def write(path: Path, make: Messages, items: Iterable[Item]) -> Path:
        with path.with_suffix(".mcap").open("wb") as stream:
            writer = McapWriter(stream, compression=compression, **options)
            writer.start(profile="ros2", library="zoo")
            _fill(writer, make, items)
            writer.finish()
        return path.with_suffix(".mcap")

    return write


def _fill(writer: McapWriter, make: Messages, items: Iterable[Item]) -> None:
    channels: dict[str, int] = {}
    for topic, kind, ns, message in items:
        if topic not in channels:
            text, _ = make.store.generate_msgdef(kind, ros_version=2)
            channels[topic] = writer.register_channel(
                topic, "cdr", writer.register_schema(kind, "ros2msg", text.encode())
            )
        writer.add_message(channels[topic], ns, bytes(make.store.serialize_cdr(message, kind)), ns)
