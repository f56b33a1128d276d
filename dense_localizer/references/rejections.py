"""Saliency that forgets: squares of a key sphere whose pixels are rejected again and again are aligned no more.

The most salient pixels may be those of leaves or of a car that was parked there once (M15 section 6.4.5). Each square
of each key sphere has a counter of how often it was seen, and how often most of its pixels were outliers.
"""

from __future__ import annotations

import json
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dense_localizer.constants import (
    MAX_FORGOTTEN_SHARE,
    MIN_REJECTED_SHARE,
    MIN_RESIDUAL_SIGMA,
    MIN_SEEN,
    MIN_SQUARE_PIXELS,
    REJECTED_SIGMAS,
    REVISIT_M,
    SQUARE_COLUMNS,
    SQUARE_ROWS,
)
from sphere_nav.estimation.kernels import SIGMA_OF_MAD
from sphere_nav.estimation.robust import median_and_mad
from sphere_nav.geometry import Spherical
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.files.untrusted import load_json, printable, read_text, short


class Rejections:
    """Counters (2, SQUARE_ROWS, SQUARE_COLUMNS) by id of the key sphere: seen, rejected."""

    def __init__(self, counts: dict[int, NDArray[np.int64]] | None = None) -> None:
        self.counts = counts or {}
        self._place: dict[int, Array] = {}
        self._forgotten = {sphere_id: select_forgotten(count) for sphere_id, count in self.counts.items()}

    def is_due(self, sphere_id: int, point_map: Array) -> bool:
        """Whether the camera has moved since a sphere was counted."""
        before = self._place.get(sphere_id)
        return before is None or float(np.linalg.norm(point_map - before)) >= REVISIT_M

    def add(self, sphere_id: int, point_map: Array, points: Array, residual: Array) -> bool:
        """Count points (N, 3) of a sphere with their residuals (N,); say whether other squares are forgotten now."""
        self._place[sphere_id] = point_map
        median, mad = median_and_mad(residual)
        is_outlier = np.abs(residual - median) > REJECTED_SIGMAS * max(SIGMA_OF_MAD * mad, MIN_RESIDUAL_SIGMA)
        row, column = locate_squares(points)
        number, outliers = np.zeros((SQUARE_ROWS, SQUARE_COLUMNS)), np.zeros((SQUARE_ROWS, SQUARE_COLUMNS))
        np.add.at(number, (row, column), 1.0)
        np.add.at(outliers, (row, column), is_outlier.astype(float))
        count = self.counts.setdefault(sphere_id, np.zeros((2, SQUARE_ROWS, SQUARE_COLUMNS), np.int64))
        is_seen = number >= MIN_SQUARE_PIXELS
        count[0] += is_seen
        count[1] += is_seen & (outliers > 0.5 * number)
        before, self._forgotten[sphere_id] = self._forgotten.get(sphere_id), select_forgotten(count)
        return not np.array_equal(
            self._forgotten[sphere_id], np.zeros((SQUARE_ROWS, SQUARE_COLUMNS), bool) if before is None else before
        )

    def share(self, sphere_id: int) -> float:
        """Return the share 0..1 of the squares of a sphere that are forgotten."""
        squares = self._forgotten.get(sphere_id)
        return float(np.mean(squares)) if squares is not None else 0.0

    def mask(self, sphere_id: int, camera: Spherical) -> NDArray[np.bool_] | None:
        """Return which pixels (H, W) of a sphere are forgotten; None for none."""
        squares = self._forgotten.get(sphere_id)
        if squares is None or not squares.any():
            return None
        rows = (np.arange(camera.height) + camera.offset_v + 0.5) * (SQUARE_ROWS / camera.full_height)
        columns = (np.arange(camera.width) + camera.offset_u + 0.5) * (SQUARE_COLUMNS / camera.full_width)
        row, column = np.clip(rows, 0, SQUARE_ROWS - 1).astype(int), columns.astype(int) % SQUARE_COLUMNS
        chosen: NDArray[np.bool_] = squares[row[:, None], column[None, :]]
        return chosen

    def write(self, path: Path, map_id: str, *, is_overwriting: bool = False) -> None:
        """Write what was counted; ValueError where something is, but for rejections of this map to be overwritten."""
        if os.path.lexists(path):
            if not is_overwriting:
                raise ValueError(f"{path}: expected no such file, found one: it is not overwritten")
            read_rejections(path, map_id)  # nothing else is
        spheres = {str(sphere_id): count.tolist() for sphere_id, count in sorted(self.counts.items())}
        text = json.dumps({"map_id": map_id, "spheres": spheres}) + "\n"
        with tempfile.TemporaryDirectory(prefix=".rejections", dir=path.parent) as folder:
            beside = Path(folder, path.name)  # a disk that is full leaves the old file alone
            beside.write_text(text, encoding="utf-8")
            beside.replace(path)


def read_rejections(path: Path, map_id: str) -> Rejections:
    """Return what `write` has written about a map; ValueError for anything else."""
    try:
        content: Any = load_json(path, read_text(path, "file of rejections"))
        counts = {int(key): np.array(value, np.int64) for key, value in content["spheres"].items()}
        found = str(content["map_id"])
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        expected = "rejections as `sphere_nav localize --rejections` writes"
        raise ValueError(f"{path}: expected {expected}, found {printable(str(error))[:200]}") from None
    if found != map_id:
        raise ValueError(f"{path}: map_id: expected {map_id}, found {short(found)}")
    if any(count.shape != (2, SQUARE_ROWS, SQUARE_COLUMNS) or np.any(count < 0) for count in counts.values()):
        raise ValueError(f"{path}: spheres: expected counters of 2 x {SQUARE_ROWS} x {SQUARE_COLUMNS}, found others")
    return Rejections(counts)


def locate_squares(points: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return row and column (N,) of the squares of points (N, 3) in the frame of their sphere."""
    x, y, z = points.T
    elevation = np.arcsin(np.clip(z / np.maximum(np.linalg.norm(points, axis=1), 1e-9), -1.0, 1.0))
    row = np.clip((0.5 - elevation / np.pi) * SQUARE_ROWS, 0, SQUARE_ROWS - 1).astype(np.int64)
    column = np.floor((0.5 - np.arctan2(y, x) / (2.0 * np.pi)) * SQUARE_COLUMNS).astype(np.int64) % SQUARE_COLUMNS
    return row, column


def select_forgotten(count: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return the squares (rows, columns) that are forgotten by counters (2, rows, columns): the worst ones."""
    seen, rejected = count
    share = np.where(seen >= MIN_SEEN, rejected / np.maximum(seen, 1), 0.0).ravel()
    most = int(MAX_FORGOTTEN_SHARE * np.count_nonzero(seen))
    worst = np.argsort(-share, kind="stable")[:most]
    chosen = np.zeros(share.size, bool)
    chosen[worst[share[worst] >= MIN_REJECTED_SHARE]] = True
    return chosen.reshape(seen.shape)
