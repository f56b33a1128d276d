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
from sphere_mapping.acquisition.stitching.views import RigView
from sphere_nav.geometry.arrays import Array, Bytes, Flags, Floats, Integers
from sphere_nav.geometry.cameras.camera import pixel_rays

WINDOW = np.argwhere(np.ones((DETAIL_WINDOW, DETAIL_WINDOW))) - DETAIL_WINDOW // 2  # rows, columns around a direction


@dataclass(frozen=True, eq=False)
class Overlap:
    """Two cameras by number, and where (H, W) of the grid both see.

    chosen: (N, 2), rows and columns of the directions that are compared; angles: those (2, N) of both in rad.
    """

    cameras: tuple[int, int]
    both: Flags
    chosen: Integers
    angles: Array


@dataclass(frozen=True, eq=False)
class Shared:
    """What pairs of cameras have in common: their numbers (2, N), angles (2, N) in rad, levels (2, N, channels)."""

    cameras: Integers
    angles: Array
    levels: Array


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
        angles = [off_axis(rig_view.T_sphere_camera.inverse().apply(rays)) for rig_view in rig_views]
        rows = (np.arange(OVERLAP_GRID.height)[:, None] + 0.5) * np.pi / OVERLAP_GRID.height
        is_even = np.random.default_rng(0).random((OVERLAP_GRID.height, OVERLAP_GRID.width)) < np.sin(rows)
        self.pairs = []
        for a, b in combinations(range(len(rig_views)), 2):
            both = is_inside[a] & is_inside[b]
            chosen = np.argwhere(both & is_even)
            if len(chosen) >= MIN_SHARED:
                chosen = chosen[:: -(-len(chosen) // MAX_SHARED)]
                own = np.stack([angles[k][*chosen.T] for k in (a, b)])
                self.pairs.append(Overlap((a, b), both, chosen, own))

    def compare(self, images: Mapping[int, Bytes]) -> Shared | None:
        """Return what pairs of the images (h, w[, 3]) by number of the camera have in common; None: nothing."""
        planes = {}
        for k, image in images.items():
            drawn = cv2.remap(_shrink(image, self._steps[k]), *self._maps[k], cv2.INTER_LINEAR)
            planes[k] = drawn if drawn.ndim == 3 else drawn[:, :, None]
        logs = {k: _mean_logarithm(plane) for k, plane in planes.items()}
        found, (low, high) = [], EXPOSED
        for pair in self.pairs:
            if set(pair.cameras) <= set(images):
                fits = is_same_detail(logs[pair.cameras[0]], logs[pair.cameras[1]], pair.both, pair.chosen)
                levels = np.stack([planes[k][*pair.chosen[fits].T] for k in pair.cameras]).astype(np.float64)
                good = np.all((levels > low) & (levels < high), axis=(0, 2))
                if (number := np.count_nonzero(good)) >= MIN_SHARED:
                    cameras = np.repeat(np.array(pair.cameras)[:, None], number, axis=1)
                    found.append((cameras, pair.angles[:, fits][:, good], levels[:, good]))
        return Shared(*(np.concatenate(parts, axis=1) for parts in zip(*found, strict=True))) if found else None


def is_same_detail(first: Floats, second: Floats, both: Flags, chosen: Integers) -> Flags:
    """Return at which of the chosen places (N, 2) of two images (H, W) of logarithms the detail around correlates.

    Or neither has any. both: where (H, W) both are seen; columns wrap around.
    """
    height, width = both.shape
    rows, columns = chosen[:, :1] + WINDOW[:, 0], (chosen[:, 1:] + WINDOW[:, 1]) % width
    around = np.clip(rows, 0, height - 1), columns
    known = both[around] & (rows >= 0) & (rows < height)
    number = np.maximum(known.sum(axis=1, keepdims=True), 1)
    x, y = (np.where(known, plane[around].astype(np.float64), 0.0) for plane in (first, second))
    x, y = (np.where(known, part - part.sum(axis=1, keepdims=True) / number, 0.0) for part in (x, y))
    aa, bb, ab = (np.sum(one * other, axis=1) / number[:, 0] for one, other in ((x, x), (y, y), (x, y)))
    most, least = np.maximum(aa, bb), np.minimum(aa, bb)
    is_like = (ab > MIN_CORRELATION * np.sqrt(most * least)) & (least > FAINT_DETAIL**2)
    return both[*chosen.T] & (is_like | (most < FLAT_DETAIL**2))


def off_axis(points: Array) -> Array:
    """Return the angle (...,) in rad between the optical axis and points (..., 3) of a camera's frame; NaN for NaN."""
    return np.arctan2(np.linalg.norm(points[..., :2], axis=-1), points[..., 2])


def _mean_logarithm(plane: Floats) -> Floats:
    """Return the mean (h, w) over the channels of the logarithms of levels (h, w, channels)."""
    logs: Floats = np.log(np.maximum(plane, np.float32(1.0)))
    total = logs[:, :, 0]
    for channel in range(1, logs.shape[2]):  # NumPy's sum along so short an axis takes several times as long
        total = total + logs[:, :, channel]
    return np.asarray(total / logs.shape[2], np.float32)


def _step(rig_view: RigView) -> int:
    camera = rig_view.camera
    return max(min(round(camera.pixels_per_radian * OVERLAP_CELL), camera.width, camera.height), 1)


def _shrink(image: Bytes, step: int) -> Floats:
    """Return the image with pixels `step` times as large; a whole number of pixels each, which is much faster."""
    height, width = image.shape[0] // step, image.shape[1] // step
    whole = image[: height * step, : width * step]
    return cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA).astype(np.float32)
