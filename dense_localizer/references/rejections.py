"""Saliency that forgets: squares of a key sphere whose pixels are rejected again and again are aligned no more.

The most salient pixels may be those of leaves or of a car that was parked there once (M15 section 6.4.5). Each square
of each key sphere has a counter of how often it was seen, and how often most of its pixels were outliers.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sphere_nav.estimation.kernels import SIGMA_OF_MAD
from sphere_nav.estimation.robust import median_and_mad
from sphere_nav.geometry import Spherical

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
ROWS, COLUMNS = 32, 64  # squares of a whole sphere
MIN_PIXELS = 4  # looked at in a square, for it to count
OUTLIER_SIGMAS, MIN_SIGMA = 3.0, 1.0  # of residuals; grey levels
MIN_STEP_M = 0.2  # of the camera, before it counts again: a drive that waits sees one thing once
# By chance a square with a twentieth of outliers is rejected once in 70 times, six of eight times in 10^-10 of all.
MIN_SEEN, MIN_SHARE = 8, 0.75
MAX_SHARE = 0.3  # of the squares seen of a sphere, the most that are forgotten


class Rejections:
    """Counters (2, ROWS, COLUMNS) by id of the key sphere: seen, rejected."""

    def __init__(self, counts: dict[int, NDArray[np.int64]] | None = None) -> None:
        self.counts = counts or {}
        self._place: dict[int, Array] = {}
        self._forgotten = {sphere_id: forgotten(count) for sphere_id, count in self.counts.items()}

    def is_due(self, sphere_id: int, point_map: Array) -> bool:
        """Whether the camera has moved since a sphere was counted."""
        before = self._place.get(sphere_id)
        return before is None or float(np.linalg.norm(point_map - before)) >= MIN_STEP_M

    def add(self, sphere_id: int, point_map: Array, points: Array, residual: Array) -> bool:
        """Count points (N, 3) of a sphere with their residuals (N,); say whether other squares are forgotten now."""
        self._place[sphere_id] = point_map
        median, mad = median_and_mad(residual)
        is_outlier = np.abs(residual - median) > OUTLIER_SIGMAS * max(SIGMA_OF_MAD * mad, MIN_SIGMA)
        row, column = square_of(points)
        number, outliers = np.zeros((ROWS, COLUMNS)), np.zeros((ROWS, COLUMNS))
        np.add.at(number, (row, column), 1.0)
        np.add.at(outliers, (row, column), is_outlier.astype(float))
        count = self.counts.setdefault(sphere_id, np.zeros((2, ROWS, COLUMNS), np.int64))
        is_seen = number >= MIN_PIXELS
        count[0] += is_seen
        count[1] += is_seen & (outliers > 0.5 * number)
        before, self._forgotten[sphere_id] = self._forgotten.get(sphere_id), forgotten(count)
        return not np.array_equal(
            self._forgotten[sphere_id], np.zeros((ROWS, COLUMNS), bool) if before is None else before
        )

    def share(self, sphere_id: int) -> float:
        """Return the share 0..1 of the squares of a sphere that are forgotten."""
        squares = self._forgotten.get(sphere_id)
        return float(np.mean(squares)) if squares is not None else 0.0

    def mask(self, sphere_id: int, camera: Spherical) -> Mask | None:
        """Return which pixels (H, W) of a sphere are forgotten; None for none."""
        squares = self._forgotten.get(sphere_id)
        if squares is None or not squares.any():
            return None
        rows = (np.arange(camera.height) + camera.offset_v + 0.5) * (ROWS / camera.full_height)
        columns = (np.arange(camera.width) + camera.offset_u + 0.5) * (COLUMNS / camera.full_width)
        row, column = np.clip(rows, 0, ROWS - 1).astype(int), columns.astype(int) % COLUMNS
        chosen: Mask = squares[row[:, None], column[None, :]]
        return chosen

    def write(self, path: Path, map_id: str, *, is_overwriting: bool = False) -> None:
        """Write what was counted; ValueError where something is, unless it is a file to be overwritten."""
        if path.exists() and not (is_overwriting and path.is_file()):
            raise ValueError(f"{path}: expected no such file, found one: it is not overwritten")
        spheres = {str(sphere_id): count.tolist() for sphere_id, count in sorted(self.counts.items())}
        beside = path.with_name(f".{path.name}.part")  # a disk that is full leaves the old file alone
        try:
            beside.write_text(json.dumps({"map_id": map_id, "spheres": spheres}) + "\n", encoding="utf-8")
            beside.replace(path)
        finally:
            beside.unlink(missing_ok=True)


def read_rejections(path: Path, map_id: str) -> Rejections:
    """Return what `write` has written about a map; ValueError for anything else."""
    try:
        content: Any = json.loads(path.read_text(encoding="utf-8"))
        counts = {int(key): np.array(value, np.int64) for key, value in content["spheres"].items()}
        found = str(content["map_id"])
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        raise ValueError(
            f"{path}: expected rejections as `sphere_nav localize --rejections` writes, found {error}"
        ) from None
    if found != map_id:
        raise ValueError(f"{path}: map_id: expected {map_id}, found {found}")
    if any(count.shape != (2, ROWS, COLUMNS) or np.any(count < 0) for count in counts.values()):
        raise ValueError(f"{path}: spheres: expected counters of 2 x {ROWS} x {COLUMNS}, found others")
    return Rejections(counts)


def square_of(points: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return row and column (N,) of the squares of points (N, 3) in the frame of their sphere."""
    x, y, z = points.T
    elevation = np.arcsin(np.clip(z / np.maximum(np.linalg.norm(points, axis=1), 1e-9), -1.0, 1.0))
    row = np.clip((0.5 - elevation / np.pi) * ROWS, 0, ROWS - 1).astype(np.int64)
    column = np.floor((0.5 - np.arctan2(y, x) / (2.0 * np.pi)) * COLUMNS).astype(np.int64) % COLUMNS
    return row, column


def forgotten(count: NDArray[np.int64]) -> Mask:
    """Return the squares (ROWS, COLUMNS) that are forgotten by counters (2, ROWS, COLUMNS): the worst ones."""
    seen, rejected = count
    share = np.where(seen >= MIN_SEEN, rejected / np.maximum(seen, 1), 0.0).ravel()
    most = int(MAX_SHARE * np.count_nonzero(seen))
    worst = np.argsort(-share, kind="stable")[:most]
    chosen = np.zeros(share.size, bool)
    chosen[worst[share[worst] >= MIN_SHARE]] = True
    return chosen.reshape(seen.shape)
