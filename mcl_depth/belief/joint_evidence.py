"""The evidence of all images so far for every heading and cell of a map, summed along odometry.

A pose of the map is moved by odometry from image to image, and what the images say of it is added up. Only whole cells
and steps of headings are moved; what is left of the way is remembered for each heading, so nothing is rounded twice.
Odometry errs: every second image a pose may also come from a neighbouring cell or heading, at a cost. That is the
algorithm of Viterbi (1967) on the grid: each element holds the evidence of the best way that ends there.

Evidence is counted by the way, not by the image: what images of one street say, right or wrong, is alike over about a
metre, so the second of two that are nearer says only what is left. An image counts in full after a cell's diagonal.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from mcl_depth.belief.motion_model import relative_motion, way_of, wrap_angle
from mcl_depth.constants import COST, FORGETTING, NEW_TURN, STEP_EVERY
from mcl_depth.likeness.depth_map import DepthMap
from sphere_nav.geometry.arrays import Array

ASIDE = np.stack([f(np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)) for f in (np.cos, np.sin)], axis=1)  # directions
Field = NDArray[np.float32]  # (A, X, Y) by heading and cell


class SurveyGrid:
    """The cells of a map that are compared with every image: all of them, or a coarser grid of a large map."""

    def __init__(self, depth_map: DepthMap, middles: Array) -> None:
        """`middles` (K, 2) m of the area; no more cells than the depth cache holds beside those of particles."""
        cells = np.unique(depth_map.cells(middles), axis=0)
        limit = max(int(0.8 * depth_map.cache.capacity), 1)
        stride = 1
        while len(np.unique(cells // stride, axis=0)) > limit:
            stride += 1
        off_middle = np.abs(cells % stride - stride // 2).sum(axis=1)
        nearest = cells[np.argsort(off_middle, kind="stable")]
        coarse, first = np.unique(nearest // stride, axis=0, return_index=True)
        chosen = nearest[first]
        self.edge, self.diagonal = depth_map.edge * stride, float(np.sqrt(2.0)) * depth_map.edge  # m, of a cell
        self.positions = (chosen + 0.5) * depth_map.edge  # (K, 2) m, compared
        self._low = coarse.min(axis=0)
        self.index = coarse - self._low  # (K, 2)
        self.shape = tuple(int(n) for n in self.index.max(axis=0) + 1)
        self.mask = np.zeros(self.shape, np.bool_)
        self.mask[tuple(self.index.T)] = True

    def poses_of(self, places: NDArray[np.int64], num_headings: int) -> Array:
        """Return the poses (N, 3) of elements (N, 3) of a field: heading, x, y."""
        xy = (places[:, 1:] + self._low + 0.5) * self.edge
        return np.column_stack([xy, wrap_angle(2.0 * np.pi * places[:, 0] / num_headings)])


class JointEvidence:
    """The field of the last images, each moved to the newest one by odometry."""

    def __init__(self, edge: float, new_way: float) -> None:
        """`edge` m is that of an element; after `new_way` m an image counts in full."""
        self._edge, self._new_way = edge, new_way
        self.reset()

    def reset(self) -> None:
        """Forget all images."""
        self._total: Field | None = None
        self._num_remembered = 0.0  # images: those that count in full, and less for each since
        self._num_images = 0.0  # that count in full, since odometry was last let err
        self._last: Array | None = None  # odometry
        self._reach = np.full(len(ASIDE), -np.inf)  # m, the farthest of all images in each direction

    def add(self, field: Field, odometry: Array | None) -> tuple[Field, float, float]:
        """Add an image, taken at `odometry` (3,); return the sum, of how many images, and how far apart these are, m.

        Without odometry, and after a gap in it, it stands alone: who may have gone anywhere fits somewhere.
        """
        if self._total is None or odometry is None or self._last is None:
            self.reset()
            self._total, self._num_remembered, self._num_images = field, 1.0, 1.0
            self._rests, self._turn = np.zeros((len(field), 2)), 0.0
        else:
            motion = relative_motion(self._last, odometry)
            news = min(way_of(motion) / self._new_way + abs(float(motion[2])) / NEW_TURN, 1.0)  # 0 to 1
            kept = FORGETTING ** np.float32(news)
            self._total = kept * self._propagate(self._total, motion) + np.float32(news) * field
            self._num_remembered = float(kept) * self._num_remembered + news
            self._num_images += news
        self._last = odometry
        if odometry is not None:
            np.maximum(self._reach, ASIDE @ odometry[:2], out=self._reach)
        extent_m = max(float(np.max(self._reach + np.roll(self._reach, len(ASIDE) // 2))), 0.0)
        return self._total, self._num_remembered, extent_m

    def _propagate(self, total: Field, motion: Array) -> Field:
        """Return the sum for the poses after a motion (3,) in the vehicle's axes."""
        count = len(total)
        step = 2.0 * np.pi / count
        angles = step * np.arange(count) + self._turn
        cosines, sines = np.cos(angles), np.sin(angles)
        self._rests[:, 0] += cosines * motion[0] - sines * motion[1]
        self._rests[:, 1] += sines * motion[0] + cosines * motion[1]
        shifts = np.round(self._rests / self._edge).astype(np.int64)
        turn = round((self._turn + float(motion[2])) / step)
        self._turn += float(motion[2]) - turn * step
        self._rests = np.roll(self._rests - shifts * self._edge, turn, axis=0)
        moved = shift_headings(total, shifts, turn)  # of a place that was off the map nothing is known
        if self._num_images < STEP_EVERY:
            return moved
        self._num_images -= STEP_EVERY
        return relax(moved)


def shift_headings(field: Field, shifts: NDArray[np.int64], turn: int) -> Field:
    """Return field[a, x, y] at [a + turn, x + shifts[a, 0], y + shifts[a, 1]]; 0 where nothing comes from."""
    moved = np.zeros_like(field)
    for a, shift in enumerate(shifts.tolist()):
        sides = list(zip(shift, field.shape[1:], strict=True))
        to: Any = tuple(slice(max(step, 0), max(side + min(step, 0), 0)) for step, side in sides)
        source: Any = tuple(slice(max(-step, 0), max(side - max(step, 0), 0)) for step, side in sides)
        moved[((a + turn) % len(shifts), *to)] = field[(a, *source)]
    return moved


def relax(field: Field) -> Field:
    """Return the best of each element, its neighbouring headings less COST, and the neighbouring cells of these."""
    turned = np.maximum(field, np.maximum(np.roll(field, 1, axis=0), np.roll(field, -1, axis=0)) - COST)
    beside = [maximum_filter1d(turned, 3, axis, mode="nearest") for axis in (1, 2)]
    best: Field = np.maximum(turned, np.maximum(*beside) - COST)
    return best
