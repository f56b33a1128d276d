"""Spheres in memory, compressed; each is decoded when it is asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import zstandard
from rclpy.serialization import deserialize_message, serialize_message
from sphere_nav_msgs.msg import AugmentedSphere

from node_kit.conversions import message_to_sphere
from sphere_map.sphere import Sphere

ZSTD_LEVEL = 1


class CompactSpheres(Mapping[int, Sphere]):
    """Spheres by id."""

    def __init__(self) -> None:
        self._frames: dict[int, bytes] = {}

    def add(self, message: AugmentedSphere) -> None:
        """Keep a sphere, or another one under its id; ValueError for a message that is none."""
        message_to_sphere(message)
        self._frames[int(message.id)] = zstandard.ZstdCompressor(ZSTD_LEVEL).compress(serialize_message(message))

    def __getitem__(self, sphere_id: int) -> Sphere:
        data = zstandard.ZstdDecompressor().decompress(self._frames[sphere_id])
        return message_to_sphere(deserialize_message(data, AugmentedSphere))

    def __len__(self) -> int:
        return len(self._frames)

    def __iter__(self) -> Iterator[int]:
        return iter(self._frames)
