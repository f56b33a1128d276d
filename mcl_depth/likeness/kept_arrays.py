"""Arrays kept in a folder between runs: made beside it and renamed, so that a reader finds all of them or none."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

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
