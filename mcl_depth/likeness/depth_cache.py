"""Features of synthesised depth images by position (algorithm 2, D_cache): a bounded memory, kept on disk if wanted."""

from __future__ import annotations

from collections import OrderedDict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mcl_depth.likeness.features import Stack
from mcl_depth.likeness.kept_arrays import load_arrays, save_arrays

Cell = tuple[int, int]
Cells = NDArray[np.int64]  # (N, 2)


def keys_of(cells: Cells) -> list[Cell]:
    """Return what cells are looked up by."""
    return [(x, y) for x, y in np.asarray(cells).tolist()]


class DepthCache:
    """Slots of one stack of features; the least recently used is given away when all are taken."""

    def __init__(self, max_bytes: int, one: Stack) -> None:
        """`one` panorama shows what is to be kept of each."""
        self.capacity = max(max_bytes // one.nbytes, 1)
        self.stack = one.room(self.capacity)
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

    def find(self, cells: Cells) -> NDArray[np.int64]:
        """Return the slots (N,) of cells, -1 where there is none; what is found counts as used now."""
        keys = keys_of(cells)
        slots = np.array([self._slots.get(key, -1) for key in keys], dtype=np.int64)
        known = np.flatnonzero(slots >= 0)
        for index in known:
            self._slots.move_to_end(keys[index])
        self.num_hits, self.num_misses = self.num_hits + len(known), self.num_misses + len(keys) - len(known)
        return slots

    def insert(self, cells: Cells, features: Stack) -> NDArray[np.int64]:
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
        last = slice(max(len(cells) - self.capacity, 0), len(cells))
        kept = type(self.stack)(*(part[last] for part in parts))
        self.insert(cells[last], kept)
        return len(kept)
