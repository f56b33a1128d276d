"""Spheres that wait on the disk; each is decoded when it is asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from sphere_nav_msgs.msg import AugmentedSphere

from node_kit.conversions import message_to_sphere
from node_kit.serialization import view_message
from node_kit.spool import Spool
from sphere_map.sphere import Sphere


class CompactSpheres(Mapping[int, Sphere]):
    """Spheres by id."""

    def __init__(self) -> None:
        self._places: dict[int, int] = {}
        self._spool = Spool()

    def add(self, data: bytes) -> None:
        """Keep a sphere, an AugmentedSphere in CDR, or another one under its id; ValueError for bytes that are none."""
        message = _message_of(data)
        message_to_sphere(message)
        self._places[int(message.id)] = self._spool.add(data)

    def __getitem__(self, sphere_id: int) -> Sphere:
        return message_to_sphere(_message_of(self._spool[self._places[sphere_id]]))

    def __len__(self) -> int:
        return len(self._places)

    def __iter__(self) -> Iterator[int]:
        return iter(self._places)


def _message_of(data: bytes) -> AugmentedSphere:
    message: AugmentedSphere = view_message(memoryview(data), AugmentedSphere, "sphere")
    return message
