"""Where the vehicle may be: places with ground beneath and free space around the camera, in pieces of some size.

The ground is the lowest surface of the map in a grid, smoothed over holes nearby.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, label, map_coordinates
from scipy.spatial import cKDTree

from mcl_depth.constants import CLEARANCE, GROUND_REACH, GROUND_STEP, MAX_BLIND_M, MAX_ELEMENTS, MIN_FLOOR_SHARE
from mcl_depth.geometry.survey_frame import numbers_of
from mcl_depth.params import AreaParams
from sphere_nav.geometry.arrays import Array


class Area:
    """Squares of side `step`, given by their middles."""

    def __init__(self, middles: Array, step: float) -> None:
        """`middles` (K, 2) m; ValueError where there is none."""
        if not len(middles):
            raise ValueError("area: expected a place with ground and free space around the camera, found none")
        self.middles, self.step = middles, step

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """Return positions (count, 2), evenly spread and yet random."""
        places = (rng.random() + np.arange(count)) / count * len(self.middles)
        chosen = self.middles[np.minimum(places.astype(np.int64), len(self.middles) - 1)]
        return chosen + (rng.random((count, 2)) - 0.5) * self.step

    def contains(self, positions: Array) -> NDArray[np.bool_]:
        """Return which positions (N, 2) lie in one of the squares, or beside one."""
        return cKDTree(self.middles).query(positions)[0] <= self.step


def find_area(points: NDArray[np.floating], heights: Callable[[Array], Array], params: AreaParams) -> Area:
    """Return the largest connected area, and others that are rooms; `points` (N, 3) are the map.

    `heights` is the camera's height at (N, 2). A closed door parts rooms for the vehicle, not for where it may begin.
    """
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    if (limits := limits_of(params.limits)) is not None:
        low, high = np.maximum(low, limits[:2]), np.minimum(high, limits[2:])
    counts = np.maximum(np.ceil((high - low) / params.step), 0).astype(np.int64)
    if counts.min() < 1 or counts.prod() > MAX_ELEMENTS:
        raise ValueError(f"area: expected 1 to {MAX_ELEMENTS} squares of {params.step:g} m, found {counts.tolist()}")
    axes = (low[i] + (np.arange(counts[i]) + 0.5) * params.step for i in range(2))
    middles = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2).astype(np.float64)
    above = points[:, 2] - heights(points[:, :2].astype(np.float64))
    in_the_way = _is_near(middles, points[np.abs(above) < CLEARANCE])
    free = (np.isfinite(heights(middles)) & ~in_the_way).reshape(counts)
    pieces, num_pieces = label(free)
    if not num_pieces:
        return Area(middles[:0], params.step)
    sizes = np.bincount(pieces.ravel(), minlength=num_pieces + 1)[1:]
    is_kept = sizes * params.step**2 >= params.min_piece
    if np.count_nonzero(is_kept) > 1:
        # below the camera at their own place: ground is lent to squares without any, along the outside of every wall
        has_floor = _is_near(middles, points[above < -CLEARANCE])
        is_kept &= np.bincount(pieces.ravel(), has_floor.ravel(), num_pieces + 1)[1:] > MIN_FLOOR_SHARE * sizes
    is_kept[np.argmax(sizes)] = True
    return Area(middles[np.append(False, is_kept)[pieces].ravel()], params.step)


def limits_of(text: str) -> Array | None:
    """Read x0,y0,x1,y1; ValueError where it is something else."""
    numbers = numbers_of(text, 4, "area.limits: expected x0,y0,x1,y1 with x0 < x1, y0 < y1")
    if numbers is not None and not np.all(numbers[:2] < numbers[2:]):
        raise ValueError(f"area.limits: expected x0 < x1, y0 < y1, found {text!r}")
    return numbers


def _is_near(middles: Array, points: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Return which of the middles (K, 2) have one of the points (N, 3) above or below them, within `CLEARANCE`."""
    if not len(points):
        return np.zeros(len(middles), np.bool_)
    side = 0.25 * CLEARANCE
    cells = np.unique(np.round(points[:, :2] / side).astype(np.int64), axis=0) * side
    found: NDArray[np.bool_] = cKDTree(cells).query(middles, distance_upper_bound=CLEARANCE)[0] < CLEARANCE
    return found


class Ground:
    """Height of the ground under (x, y), from points (N, 3) of the map.

    A scanner that stood at the origin saw no ground beneath it: such a hole is filled whatever its size.
    """

    def __init__(self, points: NDArray[np.floating]) -> None:
        self._low = points[:, :2].min(axis=0).astype(np.float64)
        cells = np.floor((points[:, :2] - self._low) / GROUND_STEP).astype(np.int64)
        shape = cells.max(axis=0) + 1
        if shape.prod() > MAX_ELEMENTS:
            raise ValueError(
                f"ground: expected at most {MAX_ELEMENTS} squares of {GROUND_STEP:g} m, found {shape.tolist()}"
            )
        lowest = np.full(shape, np.inf)
        np.minimum.at(lowest, (cells[:, 0], cells[:, 1]), points[:, 2])
        x, y = (low + GROUND_STEP * (np.arange(count) + 0.5) for low, count in zip(self._low, shape, strict=True))
        below = points[points[:, 2] < 0.0]
        blind = float(np.hypot(below[:, 0], below[:, 1]).min(initial=np.inf))
        is_blind = (np.hypot(x[:, None], y) < blind) & (blind < MAX_BLIND_M)
        distance, nearest = distance_transform_edt(np.isinf(lowest), return_indices=True)
        self._heights = lowest[nearest[0], nearest[1]]
        self._heights[(distance * GROUND_STEP > GROUND_REACH) & ~is_blind] = np.nan

    def heights(self, positions: Array) -> Array:
        """Return the height (N,) m of the ground at (N, 2), bilinear; NaN where the map has no ground."""
        place = (positions - self._low) / GROUND_STEP - 0.5
        planes = np.nan_to_num(self._heights), np.isfinite(self._heights).astype(np.float64)
        total, weight = (map_coordinates(plane, place.T, order=1, mode="nearest") for plane in planes)
        outside = np.any((place < -1.0) | (place > self._heights.shape), axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where((weight > 1e-3) & ~outside, total / weight, np.nan)
