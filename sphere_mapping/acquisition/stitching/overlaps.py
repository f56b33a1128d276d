"""Where two cameras of a rig see the same directions, and what grey levels they have there.

Only what is the same in both counts: parallax and time put other things into one direction. The detail around it must
correlate, or there must be none in either.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.constants import (
    DETAIL_WINDOW,
    EXPOSED,
    FAINT_DETAIL,
    FLAT_DETAIL,
    MAX_SHARED,
    MIN_CORRELATION,
    MIN_SHARED,
    OVERLAP_CELL,
    OVERLAP_FROM_BORDER,
    OVERLAP_GRID,
    VERY_FAR_M,
)
from sphere_mapping.acquisition.stitching.strips import Block
from sphere_mapping.acquisition.stitching.views import RigView, block_around
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.camera import pixel_rays

Image = NDArray[np.uint8]
Plane = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Overlap:
    """Two cameras by number, the block of the grid in which both see, where (h, w), and their angles (h, w) rad.

    chosen: (h, w), the directions that are compared; share: (h, w), of their neighbourhood that both see.
    """

    first: int
    second: int
    block: Block
    both: NDArray[np.bool_]
    chosen: NDArray[np.bool_]
    share: Plane
    angles: tuple[Array, Array]


@dataclass(frozen=True, eq=False)
class Shared:
    """What two cameras have in common: grey levels (M, channels) and angles (M,) rad of both."""

    first: int
    second: int
    levels: tuple[Array, Array]
    angles: tuple[Array, Array]


class Overlaps:
    """The overlaps of a rig, everything taken at one distance (0: very far)."""

    def __init__(self, rig_views: Sequence[RigView], distance_m: float) -> None:
        rays = pixel_rays(OVERLAP_GRID) * (distance_m or VERY_FAR_M)
        seen = [rig_view.project(rays) for rig_view in rig_views]
        self._steps = [_step(rig_view) for rig_view in rig_views]
        self._maps = [
            tuple((plane + 0.5) / step - 0.5 for plane in part[:2])
            for part, step in zip(seen, self._steps, strict=True)
        ]
        is_inside = [part[2] > OVERLAP_FROM_BORDER for part in seen]
        angles = [_angles(rig_view, rays) for rig_view in rig_views]
        rows = (np.arange(OVERLAP_GRID.height)[:, None] + 0.5) * np.pi / OVERLAP_GRID.height
        is_even = np.random.default_rng(0).random((OVERLAP_GRID.height, OVERLAP_GRID.width)) < np.sin(rows)
        self.pairs = []
        for a, b in combinations(range(len(rig_views)), 2):
            both = is_inside[a] & is_inside[b]
            block = block_around(both, OVERLAP_GRID, 1, 0, 1)
            if block is not None and (number := np.count_nonzero(both & is_even)) >= MIN_SHARED:
                block = Block(block.row, block.column, block.height, min(block.width, OVERLAP_GRID.width))
                own = block.cut(both & is_even)
                own.flat[np.flatnonzero(own)[np.arange(number) % -(-number // MAX_SHARED) != 0]] = False
                there = block.cut(both)
                own_angles = (block.cut(angles[a]), block.cut(angles[b]))
                self.pairs.append(Overlap(a, b, block, there, own, share_of(there), own_angles))

    def compare(self, images: Mapping[int, Image]) -> list[Shared]:
        """Return what pairs of the images (h, w[, 3]) by number of the camera have in common."""
        planes = {}
        for k, image in images.items():
            drawn = cv2.remap(_shrink(image, self._steps[k]), *self._maps[k], cv2.INTER_LINEAR)
            planes[k] = drawn if drawn.ndim == 3 else drawn[:, :, None]
        logs = {k: _mean_logarithm(plane) for k, plane in planes.items()}
        found, (low, high) = [], EXPOSED
        for pair in self.pairs:
            if {pair.first, pair.second} <= set(images):
                sides = (pair.first, pair.second)
                one, other = (pair.block.cut(logs[k]) for k in sides)
                fits = pair.chosen & is_same_detail(one, other, pair.both, pair.share)
                first, second = (pair.block.cut(planes[k])[fits].astype(np.float64) for k in sides)
                good = np.all((np.minimum(first, second) > low) & (np.maximum(first, second) < high), axis=1)
                if np.count_nonzero(good) >= MIN_SHARED:
                    angles = (pair.angles[0][fits][good], pair.angles[1][fits][good])
                    found.append(Shared(*sides, (first[good], second[good]), angles))
        return found


def is_same_detail(first: Plane, second: Plane, both: NDArray[np.bool_], share: Plane) -> NDArray[np.bool_]:
    """Return where (h, w) the detail of two images of logarithms correlates, or where neither has any.

    both: where both are seen; share: `share_of(both)`.
    """
    weight = both.astype(np.float32)
    means = [_mean(plane * weight) / share for plane in (first, second)]
    moments = [_mean(a * b * weight) / share for a, b in ((first, first), (second, second), (first, second))]
    variances = [np.maximum(moments[k] - means[k] * means[k], 0.0) for k in (0, 1)]
    product = moments[2] - means[0] * means[1]
    most, least = np.maximum(*variances), np.minimum(*variances)
    is_like = (product > MIN_CORRELATION * np.sqrt(most * least)) & (least > FAINT_DETAIL * FAINT_DETAIL)
    return both & (is_like | (most < FLAT_DETAIL * FLAT_DETAIL))


def share_of(both: NDArray[np.bool_]) -> Plane:
    """Return which share (h, w) of the neighbourhood of each direction both cameras see, above zero."""
    return np.maximum(_mean(both.astype(np.float32)), np.float32(1e-6))


def angles_of(rig_view: RigView, pixels: NDArray[np.float64]) -> Array:
    """Return the angle (...,) in rad of pixels (..., 2) from the optical axis, NaN where nothing is seen."""
    rays = rig_view.camera.unproject(pixels)
    return np.arctan2(np.linalg.norm(rays[..., :2], axis=-1), rays[..., 2])


def _angles(rig_view: RigView, points: Array) -> Array:
    """Return the angle (...,) in rad between the optical axis and points (..., 3) of the sphere's frame."""
    seen = rig_view.T_sphere_camera.inverse().apply(points)
    return np.arctan2(np.linalg.norm(seen[..., :2], axis=-1), seen[..., 2])


def _mean_logarithm(plane: Plane) -> Plane:
    """Return the mean (h, w) over the channels of the logarithms of levels (h, w, channels)."""
    logs: Plane = np.log(np.maximum(plane, np.float32(1.0)))
    total = logs[:, :, 0]
    for channel in range(1, logs.shape[2]):  # NumPy's sum along so short an axis takes several times as long
        total = total + logs[:, :, channel]
    return np.asarray(total / logs.shape[2], np.float32)


def _mean(plane: Plane) -> Plane:
    return cv2.blur(plane, (DETAIL_WINDOW, DETAIL_WINDOW), borderType=cv2.BORDER_CONSTANT).astype(np.float32)


def _step(rig_view: RigView) -> int:
    camera = rig_view.camera
    return max(min(round(camera.pixels_per_radian * OVERLAP_CELL), camera.width, camera.height), 1)


def _shrink(image: Image, step: int) -> Plane:
    """Return the image with pixels `step` times as large; a whole number of pixels each, which is much faster."""
    height, width = image.shape[0] // step, image.shape[1] // step
    whole = image[: height * step, : width * step]
    return cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA).astype(np.float32)
