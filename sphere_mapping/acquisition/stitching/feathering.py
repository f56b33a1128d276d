"""What is left of a difference of light at a seam, spread over a wide band to both of its sides.

On a coarse grid of the sphere the logarithms of the levels of two views are compared where both see, near their seam.
Either view is changed by half of the difference, smoothed; away from the seam the change fades to nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.constants import (
    BAND_DEG,
    DARK,
    FADE_DEG,
    FAINT_SHARE,
    LARGEST_CHANGE,
    MIN_CHANGE,
    USUAL_CHANGE,
)
from sphere_mapping.acquisition.kernels import change_levels
from sphere_mapping.acquisition.stitching.strips import Block

Image = NDArray[np.uint8]
Plane = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Seam:
    """Two views by number, and where (h, w) of the coarse grid they are compared."""

    first: int
    second: int
    weight: Plane


def seams_of(owner: NDArray[np.int8], is_seen: Sequence[NDArray[np.bool_]], step: int) -> tuple[Seam, ...]:
    """Return the seams between views, from owners (H, W) of pixels and where each view sees (H / step, W / step)."""
    coarse = owner[step // 2 :: step, step // 2 :: step]
    reach = max(round(BAND_DEG / 360.0 * coarse.shape[1]), 1)
    kernel = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    own = [_wrap((coarse == k).astype(np.uint8), reach) for k in range(len(is_seen))]
    near = [(cv2.dilate(plane, kernel)[:, reach:-reach] > 0) & seen for plane, seen in zip(own, is_seen, strict=True)]
    pairs = [(i, j, near[i] & near[j]) for i, j in combinations(range(len(near)), 2)]
    return tuple(Seam(i, j, both.astype(np.float32)) for i, j, both in pairs if both.any())


def feather(
    parts: Sequence[Image], blocks: Sequence[Block], seams: Sequence[Seam], step: int, tiles: Sequence[Sequence[Block]]
) -> None:
    """Change the light of the views' parts (h, w[, 3]) of the sphere, so that it meets at the seams.

    tiles: what is needed of each part, by the place in it; only that is changed.
    """
    if not seams:
        return
    planes = [_coarse(part, block, seams[0].weight.shape, step) for part, block in zip(parts, blocks, strict=True)]
    changes = [np.zeros_like(plane) for plane in planes]
    for seam in seams:
        half = 0.5 * _difference(planes[seam.first], planes[seam.second], seam.weight)
        changes[seam.first] -= half
        changes[seam.second] += half
    for part, block, change, needed in zip(parts, blocks, changes, tiles, strict=True):
        inside = block.at(step.bit_length() - 1).cut(change)
        if float(np.abs(inside).max()) >= MIN_CHANGE:
            factor = np.exp(inside)
            for tile in needed:
                place = tile.row, tile.column, tile.height, tile.width
                change_levels(part.reshape(block.height, -1), factor, step, *place)


def _difference(first: Plane, second: Plane, weight: Plane) -> Plane:
    """Return the smooth difference (h, w, channels) of the logarithms of levels, 0 far from where they compare."""
    ratio = np.log(first / second)
    size = np.abs(ratio).max(axis=2)
    sure = weight / (1.0 + np.square(size / USUAL_CHANGE)) * (size < LARGEST_CHANGE)
    darkest = np.minimum(first, second).min(axis=2)
    sure = (sure * darkest**2 / (darkest**2 + DARK**2)).astype(np.float32)
    total = _smooth(sure)
    parts = [_smooth(ratio[..., k] * sure) / (total + np.float32(FAINT_SHARE)) for k in range(ratio.shape[2])]
    return np.stack(parts, axis=2)


def _coarse(part: Image, block: Block, shape: tuple[int, ...], step: int) -> Plane:
    """Return levels (h, w, channels) of the whole sphere's grid, at least 1."""
    small = cv2.resize(part, (block.width // step, block.height // step), interpolation=cv2.INTER_AREA)
    plane = np.ones((*shape, 1 if part.ndim == 2 else 3), np.float32)
    own = block.at(step.bit_length() - 1)
    columns = np.arange(own.column, own.column + min(own.width, shape[1])) % shape[1]
    values = small.reshape(own.height, own.width, -1)[:, : columns.size]
    plane[own.row : own.row + own.height, columns] = np.maximum(values, 1)
    return plane


def _smooth(plane: Plane) -> Plane:
    sigma = FADE_DEG / 360.0 * plane.shape[1]
    margin = min(round(3 * sigma) + 1, plane.shape[1])
    wide = cv2.GaussianBlur(_wrap(plane, margin), (0, 0), sigma, borderType=cv2.BORDER_CONSTANT)
    return wide[:, margin:-margin].astype(np.float32)


def _wrap(plane: NDArray, margin: int) -> NDArray:
    return cv2.copyMakeBorder(plane, 0, 0, margin, margin, cv2.BORDER_WRAP)
