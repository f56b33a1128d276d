"""What a map has of each key sphere, waiting on the disk: it is decoded when it is asked for, and takes no memory."""

from __future__ import annotations

import os
import tempfile
import weakref
from collections.abc import Callable, Iterator, Mapping, MutableMapping
from typing import TypeVar

import numpy as np
from sphere_nav_msgs.msg import AugmentedSphere

from sphere_nav.ros.bags.recorded import view_message
from sphere_nav.ros.conversions import message_to_sphere
from sphere_nav.ros.conversions.clouds import LAYOUT, features_to_table, table_to_features
from sphere_nav.spheres.appearance.features import Features
from sphere_nav.spheres.sphere import Sphere

C = TypeVar("C")


class Spool(Mapping[int, C]):
    """Things by id of their key sphere, in a file without a name, which is gone with the process."""

    def __init__(self, decode: Callable[[bytes], C]) -> None:
        self._decode = decode
        self._places: dict[int, tuple[int, int]] = {}  # number of bytes, and where they are
        self._file = tempfile.TemporaryFile()  # noqa: SIM115 (`close`)
        weakref.finalize(self, self._file.close)

    def __len__(self) -> int:
        return len(self._places)

    def __iter__(self) -> Iterator[int]:
        return iter(self._places)

    def __getitem__(self, sphere_id: int) -> C:
        return self._decode(os.pread(self._file.fileno(), *self._places[sphere_id]))

    def add(self, sphere_id: int, data: bytes) -> None:
        """Keep some bytes; OSError, naming the folder, where the disk does not take them."""
        try:
            place = self._file.seek(0, os.SEEK_END)
            self._file.write(data)
            self._file.flush()
        except OSError as error:
            error.filename = error.filename or tempfile.gettempdir()
            raise
        self._places[sphere_id] = len(data), place


class CompactFeatures(Spool[Features], MutableMapping[int, Features]):
    """Features: a search reads those of a few key spheres."""

    def __init__(self) -> None:
        super().__init__(lambda data: table_to_features(np.frombuffer(data, LAYOUT)))

    def __setitem__(self, sphere_id: int, features: Features) -> None:
        self.add(sphere_id, features_to_table(features).tobytes())

    def __delitem__(self, sphere_id: int) -> None:
        del self._places[sphere_id]


class CompactSpheres(Spool[Sphere]):
    """Spheres."""

    def __init__(self) -> None:
        super().__init__(lambda data: message_to_sphere(_message_of(data)))

    def keep(self, data: bytes) -> None:
        """Keep a sphere, an AugmentedSphere in CDR, under its id; ValueError for bytes that are none."""
        message = _message_of(data)
        message_to_sphere(message)
        self.add(int(message.id), data)


def _message_of(data: bytes) -> AugmentedSphere:
    return view_message(memoryview(data), AugmentedSphere, "sphere")
