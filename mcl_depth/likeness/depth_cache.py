"""Features of synthesised depth images by position (algorithm 2, D_cache): a bounded memory, kept on disk if wanted.

Arrays kept in a folder between runs: made beside it and renamed, so that a reader finds all of them or none.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mcl_depth.likeness.features import Stack
from sphere_nav.geometry.files.untrusted import read_npy


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


Cell = tuple[int, int]


class DepthCache:
    """Slots of one stack of features; the least recently used is given away when all are taken."""

    def __init__(self, max_bytes: int, empty: Callable[[int], Any]) -> None:
        """`empty` returns room for so many panoramas."""
        self.capacity = max(max_bytes // empty(1).nbytes, 1)
        self.stack = empty(self.capacity)  # memory is taken when written to
        self.num_hits, self.num_misses = 0, 0
        self._slots: OrderedDict[Cell, int] = OrderedDict()

    def __len__(self) -> int:
        return len(self._slots)

    def __contains__(self, cell: Cell) -> bool:
        return cell in self._slots

    @property
    def hit_rate(self) -> float:
        """Share of the look-ups that found something."""
        return self.num_hits / max(self.num_hits + self.num_misses, 1)

    def find(self, cells: Sequence[Cell]) -> NDArray[np.int64]:
        """Return the slots (N,) of cells, -1 where there is none; what is found counts as used now."""
        slots = np.full(len(cells), -1, dtype=np.int64)
        for index, cell in enumerate(cells):
            slot = self._slots.get(cell)
            if slot is not None:
                slots[index] = slot
                self._slots.move_to_end(cell)
        found = int(np.count_nonzero(slots >= 0))
        self.num_hits, self.num_misses = self.num_hits + found, self.num_misses + len(cells) - found
        return slots

    def insert(self, cells: Sequence[Cell], features: Stack) -> NDArray[np.int64]:
        """Keep features of new cells, at most `capacity` of them at once; return their slots (N,)."""
        slots = np.empty(len(cells), dtype=np.int64)
        for index, cell in enumerate(cells):
            is_full = len(self._slots) >= self.capacity
            slots[index] = self._slots.popitem(last=False)[1] if is_full else len(self._slots)
            self._slots[cell] = int(slots[index])
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
        last = slice(max(len(cells) - self.capacity, 0), len(cells))
        kept = type(self.stack)(*(part[last] for part in parts))
        self.insert([(int(x), int(y)) for x, y in cells[last]], kept)
        return len(kept)
