"""Features of synthesised depth images by position (algorithm 2, D_cache): a bounded memory, kept on disk if wanted.

Arrays kept in a folder between runs: made beside it and renamed, so that a reader finds all of them or none.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry.files.untrusted import read_npy

Cell = tuple[int, int]


def save_arrays(folder: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays by name into a folder; the last one to write wins."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    fresh = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    for name, array in arrays.items():
        np.save(fresh / f"{name}.npy", array, allow_pickle=False)
    if folder.exists():
        shutil.rmtree(folder)
    os.replace(fresh, folder)


def load_arrays(folder: Path, names: Sequence[str]) -> list[NDArray[Any]] | None:
    """Return what `save_arrays` wrote, mapped into memory; None without a folder. ValueError if damaged."""
    if not folder.is_dir():
        return None
    try:
        return [read_npy(folder / f"{name}.npy", "array of depth features") for name in names]
    except (OSError, ValueError) as error:
        raise ValueError(f"{folder}: expected a cache of depth features: {' '.join(str(error).split())}") from None


@dataclass(frozen=True)
class KeptArrays:
    """Arrays that belong together, one file each."""

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Return the names of the arrays."""
        return tuple(item.name for item in fields(cls))

    @property
    def arrays(self) -> tuple[NDArray[Any], ...]:
        """The arrays in the order of their names."""
        return tuple(getattr(self, name) for name in self.names())

    def save(self, folder: Path) -> None:
        """Write everything into a folder."""
        save_arrays(folder, dict(zip(self.names(), self.arrays, strict=True)))

    @classmethod
    def load(cls, folder: Path) -> Self | None:
        """Return what `save` wrote; None where there is no such folder. A damaged one is ValueError."""
        found = load_arrays(folder, cls.names())
        return None if found is None else cls(*map(np.array, found))


@dataclass(frozen=True)
class Stack(KeptArrays):
    """Depth features of M panoramas: arrays with a row for each."""

    def __len__(self) -> int:
        return len(self.arrays[0])

    @property
    def nbytes(self) -> int:
        """Memory of all panoramas in bytes."""
        return sum(array.nbytes for array in self.arrays)

    def room(self, capacity: int) -> Self:
        """Return room for `capacity` panoramas of this kind, to be filled by `put`; memory is taken when written to."""
        return type(self)(*(np.empty((capacity, *array.shape[1:]), array.dtype) for array in self.arrays))

    def take(self, indices: NDArray[np.integer] | slice) -> Self:
        """Return the panoramas of some indices."""
        return type(self)(*(array[indices] for array in self.arrays))

    def put(self, indices: NDArray[np.integer] | slice, other: Self) -> None:
        """Overwrite some panoramas by others."""
        for array, new in zip(self.arrays, other.arrays, strict=True):
            array[indices] = new


def keys_of(cells: NDArray[np.int64]) -> list[Cell]:
    """Return what cells (N, 2) are looked up by."""
    return [(x, y) for x, y in np.asarray(cells).tolist()]


class DepthCache:
    """Slots of one stack of features; the least recently used is given away when all are taken."""

    def __init__(self, max_bytes: int, one: Stack) -> None:
        """`one` panorama shows what is to be kept of each."""
        self.capacity = max(max_bytes // one.nbytes, 1)
        self.stack = one.room(self.capacity)
        self._slots: OrderedDict[Cell, int] = OrderedDict()

    def __len__(self) -> int:
        return len(self._slots)

    def __contains__(self, cell: Cell) -> bool:
        return cell in self._slots

    def find(self, cells: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the slots (N,) of cells, -1 where there is none; what is found counts as used now."""
        keys = keys_of(cells)
        slots = np.array([self._slots.get(key, -1) for key in keys], dtype=np.int64)
        for index in np.flatnonzero(slots >= 0):
            self._slots.move_to_end(keys[index])
        return slots

    def insert(self, cells: NDArray[np.int64], features: Stack) -> NDArray[np.int64]:
        """Keep features of new cells, at most `capacity` of them at once; return their slots (N,)."""
        for key in keys_of(cells):
            is_full = len(self._slots) >= self.capacity
            self._slots[key] = self._slots.popitem(last=False)[1] if is_full else len(self._slots)
        slots = np.array([self._slots[key] for key in keys_of(cells)], dtype=np.int64)
        self.stack.put(slots, features)
        return slots

    def save(self, folder: Path) -> None:
        """Write everything into a folder; the last one to write wins."""
        kept = self.stack.take(np.fromiter(self._slots.values(), dtype=np.int64))
        cells = np.array(list(self._slots), dtype=np.int64).reshape(-1, 2)
        save_arrays(folder, {"cells": cells} | dict(zip(kept.names(), kept.arrays, strict=True)))

    def load(self, folder: Path) -> int:
        """Read what `save` wrote, as much as fits; return how many images that are. A damaged folder is ValueError."""
        found = load_arrays(folder, ("cells", *self.stack.names()))
        if found is None:
            return 0
        cells, *parts = found
        expected = [(len(cells), *array.shape[1:]) for array in self.stack.arrays]
        if [part.shape for part in parts] != expected:
            raise ValueError(f"{folder}: expected features {expected}, found {[part.shape for part in parts]}")
        kept = type(self.stack)(*(part[-self.capacity :] for part in parts))
        self.insert(cells[-self.capacity :], kept)
        return len(kept)
