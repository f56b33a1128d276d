"""Spheres that wait on the disk; each is decoded when it is asked for.

Bytes that wait on the disk, in a file without a name: they take no memory and are gone with the process.

Features of key spheres that wait on the disk: a search reads those of a few of them.
"""

from __future__ import annotations

import os
import tempfile
import weakref
from collections.abc import Iterator, Mapping, MutableMapping
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

import numpy as np
from sphere_nav_msgs.msg import AugmentedSphere

from sphere_nav.ros.bags.serialization import view_message
from sphere_nav.ros.conversions import message_to_sphere
from sphere_nav.ros.conversions.clouds import LAYOUT, features_to_table, table_to_features
from sphere_nav.spheres.appearance.features import Features
from sphere_nav.spheres.sphere import Sphere


class Spool:
    """What was added, in that order; OSError, naming the folder, where the disk does not take it."""

    def __init__(self, folder: Path | None = None) -> None:
        """Without a folder, that of the system's temporary files."""
        self._ends, self._folder = [0], folder or Path(tempfile.gettempdir())
        self._file = tempfile.TemporaryFile(dir=self._folder)  # noqa: SIM115 (`close`)
        self._close = weakref.finalize(self, self._file.close)

    def __len__(self) -> int:
        return len(self._ends) - 1

    def __getitem__(self, index: int) -> bytes:
        if not 0 <= index < len(self):
            raise IndexError(f"spool: expected an index below {len(self)}, found {index}")
        first, end = self._ends[index : index + 2]
        return os.pread(self._file.fileno(), end - first, first)

    def __iter__(self) -> Iterator[bytes]:
        for index in range(len(self)):
            yield self[index]

    def add(self, data: bytes) -> int:
        """Add some bytes; return the index under which they are."""
        try:
            self._file.seek(self._ends[-1])
            self._file.write(data)
            self._file.flush()
        except OSError as error:
            error.filename = error.filename or str(self._folder)
            raise
        self._ends.append(self._ends[-1] + len(data))
        return len(self) - 1

    def close(self) -> None:
        """Forget all."""
        with suppress(OSError):  # of a full disk, which has been told
            self._close()


C = TypeVar("C")


class _Compact(Mapping[int, C]):
    """Things by id of their key sphere."""

    def __init__(self) -> None:
        self._places: dict[int, int] = {}
        self._spool = Spool()

    def _bytes_of(self, sphere_id: int) -> bytes:
        return self._spool[self._places[sphere_id]]

    def __len__(self) -> int:
        return len(self._places)

    def __iter__(self) -> Iterator[int]:
        return iter(self._places)


class CompactFeatures(_Compact[Features], MutableMapping[int, Features]):
    """Features by id of their key sphere."""

    def __getitem__(self, sphere_id: int) -> Features:
        return table_to_features(np.frombuffer(self._bytes_of(sphere_id), LAYOUT))

    def __setitem__(self, sphere_id: int, features: Features) -> None:
        self._places[sphere_id] = self._spool.add(features_to_table(features).tobytes())

    def __delitem__(self, sphere_id: int) -> None:
        del self._places[sphere_id]


class CompactSpheres(_Compact[Sphere]):
    """Spheres by id."""

    def add(self, data: bytes) -> None:
        """Keep a sphere, an AugmentedSphere in CDR, or another one under its id; ValueError for bytes that are none."""
        message = _message_of(data)
        message_to_sphere(message)
        self._places[int(message.id)] = self._spool.add(data)

    def __getitem__(self, sphere_id: int) -> Sphere:
        return message_to_sphere(_message_of(self._bytes_of(sphere_id)))


def _message_of(data: bytes) -> AugmentedSphere:
    return view_message(memoryview(data), AugmentedSphere, "sphere")
