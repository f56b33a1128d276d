"""Arrays kept in a folder between runs: made beside it and renamed, so that a reader finds all of them or none."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


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
        return [np.load(folder / f"{name}.npy", mmap_mode="r", allow_pickle=False) for name in names]
    except (OSError, ValueError, EOFError) as error:
        raise ValueError(f"{folder}: expected a cache of depth features: {' '.join(str(error).split())}") from None
