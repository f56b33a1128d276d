"""Halved images of a matching, how what one knows is said at the size of another, and which matches are doubtful."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.constants import (
    BORROWED_PX,
    ERODED_PX,
    JUMP,
    LEAST_NOISE,
    MIN_OWN_LIKENESS,
    OWN_FLOOR,
    OWN_LEVELS,
    OWN_RADIUS,
    SMOOTH,
    UNKNOWN_PX,
    UNKNOWN_SIDE,
)
from sphere_mapping.acquisition.kernels import smooth
from sphere_nav.geometry.arrays import Bytes, Flags, Floats


def around(plane: NDArray[Any], margin: int, *, is_whole: bool) -> NDArray[Any]:
    """Return a plane with so many columns more on each side: a whole sphere goes on, the border of a part repeats."""
    border = cv2.BORDER_WRAP if is_whole else cv2.BORDER_REPLICATE
    return cv2.copyMakeBorder(plane, 0, 0, margin, margin, border)


def smooth_around(values: Floats, radius: int, *, is_whole: bool) -> Floats:
    """Return the mean of what differs little over 2 radius + 1 rows and columns: without the stairs of whole pixels."""
    smoothed: Floats = smooth(around(values, 2 * radius, is_whole=is_whole), radius, *SMOOTH)
    return np.ascontiguousarray(smoothed[:, 2 * radius : -2 * radius])


def halve_image(image: NDArray[Any], is_whole: bool) -> NDArray[Any]:
    """Return the image (H, W) at half its size."""
    height, width = image.shape
    half = cv2.pyrDown(around(image, 4, is_whole=is_whole))[: height // 2, 2 : 2 + width // 2]
    # pixel k of the half is centred on pixel 2 k, not between 2 k and 2 k + 1: the refinement takes that up
    return np.ascontiguousarray(half)


def noise_of(noise: float, halvings: int) -> float:
    """Return the deviation of grey levels that halving leaves of a noise: it averages four pixels."""
    return max(noise / 2**halvings, min(noise, LEAST_NOISE))


def interpolate(disparity: Floats, is_whole: bool) -> Floats:
    """Return a disparity, or its deviation, at twice the size: linear between pixels, NaN beside NaN.

    Pixel k is centred on pixel 2 k; all numbers are twice as large.
    """
    right = np.roll(disparity, -1, axis=1)
    if not is_whole:
        right[:, -1] = disparity[:, -1]
    below, diagonal = (np.concatenate([plane[1:], plane[-1:]]) for plane in (disparity, right))
    double = np.empty((2 * disparity.shape[0], 2 * disparity.shape[1]), np.float32)
    double[::2, ::2], double[::2, 1::2], double[1::2, ::2] = 2 * disparity, disparity + right, disparity + below
    double[1::2, 1::2] = (disparity + right + below + diagonal) / 2
    return double


def fit(plane: Floats, shape: tuple[int, ...]) -> Floats:
    """Return the plane cut, or continued by NaN, to a shape."""
    plane = plane[: shape[0], : shape[1]]
    missing = [(0, side - found) for side, found in zip(shape, plane.shape, strict=True)]
    return np.pad(plane, missing, constant_values=np.nan) if plane.shape != shape else plane


def usable_at(is_usable: Flags, level: int, shape: tuple[int, ...]) -> Flags:
    """Return which pixels of a level are made of usable ones (H, W) only."""
    if level == 0:
        return is_usable
    side = 2 ** (level + 1) + 1
    eroded = cv2.erode(is_usable.astype(np.uint8), np.ones((side, side), np.uint8))
    return fit(eroded[:: 2**level, :: 2**level].astype(np.float32), shape) > 0


def at_jumps(disparity: Floats, radius: int, *, is_whole: bool) -> Flags:
    """Return the pixels next to a jump of disparity: blocks there see two surfaces, the nearer one looks too large."""
    high, uneven = uneven_around(disparity, radius, is_whole=is_whole)
    return uneven > np.maximum(np.float32(JUMP[0]), np.float32(JUMP[1]) * high)


def uneven_around(disparity: Floats, radius: int, *, is_whole: bool) -> tuple[Floats, Floats]:
    """Return the largest disparity (H, W) within 2 radius + 1 rows and columns, and by how much it varies beside slant.

    A slanted surface changes by the least step from pixel to pixel over the neighbourhood.
    """
    padded = around(disparity, radius + 1, is_whole=is_whole)
    kernel = np.ones((2 * radius + 1, 2 * radius + 1), np.uint8)
    high, low = _extremes(padded, kernel)
    uneven = high - low
    for axis in range(2):
        step = np.abs(np.diff(padded, axis=axis, append=np.nan))
        least = cv2.erode(np.where(np.isnan(step), np.float32(UNKNOWN_PX), step), kernel)
        uneven -= np.where(least < UNKNOWN_PX, 2 * radius * least, np.float32(0.0))
    inner = np.s_[:, radius + 1 : -radius - 1]
    return high[inner], np.maximum(uneven, 0)[inner]


def spread_around(disparity: Floats, radius: int, *, is_whole: bool) -> Floats:
    """Return by how much the disparity (H, W) varies within 2 radius + 1 rows and columns; 0 where nothing is known."""
    padded = around(disparity, radius, is_whole=is_whole)
    high, low = _extremes(padded, np.ones((2 * radius + 1, 2 * radius + 1), np.uint8))
    return np.ascontiguousarray(np.maximum(high - low, 0)[:, radius:-radius])


def is_unlike(unlike: Floats, spread: Floats, found: Floats, most: float) -> Flags:
    """Return where (H, W) images differ by far more than is usual where something is found: at edges, thin things.

    unlike: squared differences by what is allowed; spread: px by which what is found varies around. Where it does, a
    block may see two surfaces, and less is too much: differences times 1 + spread may be `most` times their median.
    """
    some = unlike[::8, ::8][~np.isnan(found[::8, ::8])]  # the median of so many is that of all
    limit = most * np.median(some) if some.size else np.inf
    return unlike * (1 + spread) > limit


def is_borrowed(top: Bytes, bottom: Bytes, disparity: Floats, *, is_whole: bool) -> Flags:
    """Return where (H, W) a disparity is known but the pixel's own surface does not show it.

    A block tells the range of its strongest texture. The sky beside a crown, a dark panel beside its frame would have
    the range of what is beside them. Of the pixels that are as bright as the middle one, their steps along the columns
    are those of noise, which both images do not share. What is only a few px wide is not told: halving blurs it.
    """
    margin, (height, width) = OWN_RADIUS, top.shape
    v, u = np.meshgrid(*(np.arange(side, dtype=np.float32) for side in top.shape), indexing="ij")
    here, there = _steady_steps(top, u, v), _steady_steps(bottom, u, v - np.nan_to_num(disparity, nan=UNKNOWN_PX))
    here[np.isnan(disparity)] = 0.0
    beyond = ((margin, margin), (0, 0), (0, 0))
    products = np.pad(around(np.dstack([here * here, there * there, here * there]), margin, is_whole=is_whole), beyond)
    levels, sums = np.pad(around(top, margin, is_whole=is_whole), beyond[:2]), np.zeros((*top.shape, 3), np.float32)
    for row, column in np.ndindex(2 * margin + 1, 2 * margin + 1):
        beside = np.s_[row : row + height, column : column + width]
        is_alike = cv2.compare(cv2.absdiff(levels[beside], top), OWN_LEVELS, cv2.CMP_LE)
        cv2.accumulate(products[beside], sums, is_alike)
    likeness = sums[..., 2] / np.sqrt(sums[..., 0] * sums[..., 1] + np.float32(OWN_FLOOR))
    unlike = (~np.isnan(disparity) & ~(likeness >= MIN_OWN_LIKENESS)).astype(np.uint8)
    return (unlike | _near_large(unlike, BORROWED_PX, is_whole=is_whole)) > 0


def _steady_steps(image: Bytes, u: Floats, v: Floats) -> Floats:
    """Return the smaller of the steps down to pixels u, v (H, W) and on from there, 0 where they turn.

    Beside an edge it is that of the surface itself.
    """
    steps = np.diff(image.astype(np.float32), axis=0, prepend=image[:1])
    before, after = (cv2.remap(steps, u, at, cv2.INTER_LINEAR) for at in (v, v + 1))
    least = np.copysign(np.minimum(np.abs(before), np.abs(after)), before)
    return np.where(before * after > 0, least, np.float32(0.0))


def twice(plane: NDArray[Any]) -> NDArray[Any]:
    """Return a plane at twice the size, every pixel four times."""
    return cv2.resize(plane, None, fx=2, fy=2, interpolation=cv2.INTER_NEAREST)


def at_unknown(disparity: Floats, *, is_whole: bool) -> Flags:
    """Return the pixels next to a large unknown region: their blocks may see the border of what is before it."""
    return _near_large(np.isnan(disparity).astype(np.uint8), UNKNOWN_SIDE, is_whole=is_whole) > 0


def _near_large(marked: Bytes, side: int, *, is_whole: bool) -> Bytes:
    """Return what is in or next to regions of marked pixels (H, W) that hold a square of so many px a side."""
    margin = side + ERODED_PX
    large = cv2.morphologyEx(around(marked, margin, is_whole=is_whole), cv2.MORPH_OPEN, np.ones((side, side), np.uint8))
    near = cv2.dilate(large, np.ones((2 * ERODED_PX + 1, 2 * ERODED_PX + 1), np.uint8))
    return np.asarray(near[:, margin:-margin], np.uint8)


def _extremes(disparity: Floats, kernel: Bytes) -> tuple[Floats, Floats]:
    """Return the largest and the least known disparity (H, W) around each pixel."""
    known = ~np.isnan(disparity)
    high = cv2.dilate(np.where(known, disparity, np.float32(-UNKNOWN_PX)), kernel)
    return high, cv2.erode(np.where(known, disparity, np.float32(UNKNOWN_PX)), kernel)
