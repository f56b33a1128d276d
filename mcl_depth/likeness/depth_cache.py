"""Features of synthesised depth images by position (algorithm 2, D_cache): a bounded memory, kept on disk if wanted.

There they are arrays in a folder: made beside it and renamed, so that a reader finds all of them or none.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections import OrderedDict
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry.files.untrusted import read_npy

Cell = tuple[int, int]
Stack: TypeAlias = Mapping[
    str, NDArray[Any]
]  # depth features of panoramas by name, the first axis is that of panoramas


def keys_of(cells: NDArray[np.int64]) -> list[Cell]:
    """Return what cells (N, 2) are looked up by."""
    return [(x, y) for x, y in np.asarray(cells).tolist()]


class DepthCache:
    """Slots of one stack of features; the least recently used is given away when all are taken."""

    def __init__(self, max_bytes: int, one: Stack) -> None:
        """`one`: features of one panorama, whatever they are."""
        self.capacity = max(max_bytes // sum(part.nbytes for part in one.values()), 1)
        shapes = {name: (self.capacity, *part.shape[1:]) for name, part in one.items()}
        self.stack = {name: np.empty(shapes[name], part.dtype) for name, part in one.items()}  # memory comes when used
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
        for name, part in self.stack.items():
            part[slots] = features[name]
        return slots

    def save(self, folder: Path) -> None:
        """Write everything into a folder; the last one to write wins."""
        cells, slots = np.array(list(self._slots), dtype=np.int64).reshape(-1, 2), list(self._slots.values())
        folder.parent.mkdir(parents=True, exist_ok=True)
        fresh = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
        for name, array in [("cells", cells), *((name, part[slots]) for name, part in self.stack.items())]:
            np.save(fresh / f"{name}.npy", array, allow_pickle=False)
        if folder.exists():
            shutil.rmtree(folder)
        os.replace(fresh, folder)

    def load(self, folder: Path) -> None:
        """Read what `save` wrote, as much as fits. A damaged folder is ValueError."""
        if not folder.is_dir():
            return
        try:
            names = ("cells", *self.stack)
            cells, *parts = (read_npy(folder / f"{name}.npy", "array of depth features") for name in names)
        except (OSError, ValueError) as error:
            raise ValueError(f"{folder}: expected a cache of depth features: {' '.join(str(error).split())}") from None
        kept = dict(zip(self.stack, parts, strict=True))
        for name, part in self.stack.items():
            expected, found = (len(cells), *part.shape[1:]), kept[name]
            if found.shape != expected or found.dtype != part.dtype:
                told = f"{found.shape} of {found.dtype}"
                raise ValueError(f"{folder}: {name}: expected {expected} of {part.dtype}, found {told}")
        self.insert(cells[-self.capacity :], {name: part[-self.capacity :] for name, part in kept.items()})
