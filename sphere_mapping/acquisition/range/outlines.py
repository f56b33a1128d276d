"""Regions of a whole sphere without texture, and pieces of their outlines that can be matched along the columns."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from sphere_mapping.acquisition.constants import (
    AROUND_PX,
    CELL_PX,
    HALF_PIECE_PX,
    MIN_ACROSS,
    MIN_EDGE_PIXELS,
    MIN_REGION_PX,
    MIN_UNKNOWN,
    OUTLINE_BLUR_PX,
    OUTLINE_EDGE,
    PIECES_APART_PX,
)
from sphere_mapping.acquisition.range.levels import usable_at

Plane = NDArray[np.float32]
Flags = NDArray[np.bool_]
Image = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Outline:
    """Pieces of the outline of a region: its number, corners (n, 2: row, column) and masks (n, S, S)."""

    region: int
    corners: NDArray[np.int64]
    masks: Flags


def bare_regions(
    top: Image, range_m: Plane, is_usable: Flags, level: int
) -> tuple[NDArray[np.int32], NDArray[np.int32], int]:
    """Return labels (h, w) of bare regions, their boxes (n, 6: number, column, row, width, height, area), and a seam.

    The labels are rolled so that the column with the fewest bare pixels, the seam, is the first.
    """
    shape, step = top.shape, 2**level
    is_bare = (_slope(top) < OUTLINE_EDGE) & usable_at(is_usable, level, shape)
    opened = cv2.morphologyEx(is_bare.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    seam = int(np.argmin(opened.sum(axis=0)))
    number, labels, boxes, _ = cv2.connectedComponentsWithStats(np.roll(opened, -seam, axis=1), connectivity=4)
    is_unknown = np.roll(np.isnan(range_m[::step, ::step][: shape[0], : shape[1]]), -seam, axis=1)
    unknown = np.bincount(labels[is_unknown], minlength=number)
    keep = (boxes[:, 4] >= MIN_REGION_PX) & (unknown >= MIN_UNKNOWN * boxes[:, 4])
    keep[0] = False
    return labels, np.column_stack([np.flatnonzero(keep), boxes[keep]]).astype(np.int32), seam


def _slope(image: Image) -> Plane:
    """Return the slope (h, w) of a blurred whole sphere, grey levels per px."""
    margin = int(4 * OUTLINE_BLUR_PX) + 2
    wide = cv2.copyMakeBorder(image, 0, 0, margin, margin, cv2.BORDER_WRAP).astype(np.float32)
    smooth = cv2.GaussianBlur(wide, (0, 0), OUTLINE_BLUR_PX)
    across, along = (cv2.Sobel(smooth, cv2.CV_32F, *axes, ksize=1, scale=0.5) for axes in ((1, 0), (0, 1)))
    return np.asarray(np.hypot(across, along)[:, margin:-margin], dtype=np.float32)


def cut_outlines(top: Image, labels: NDArray[np.int32], boxes: NDArray[np.int32]) -> Iterator[Outline]:
    """Yield the outline of each region, of an image and labels (h, w) and boxes as `bare_regions` has them."""
    is_edge = _slope(top) >= OUTLINE_EDGE
    height, width = labels.shape
    margin, side = AROUND_PX + HALF_PIECE_PX + CELL_PX, 2 * HALF_PIECE_PX + 1
    for number, column, row, box_width, box_height, _ in boxes:
        rows = slice(max(row - margin, 0), min(row + box_height + margin, height))
        columns = slice(max(column - margin, 0), min(column + box_width + margin, width))
        inside = (labels[rows, columns] == number).astype(np.uint8)
        near = cv2.dilate(inside, np.ones((2 * AROUND_PX + 1,) * 2, np.uint8)) > 0
        v, u = np.nonzero(near & is_edge[rows, columns])
        if v.size == 0:
            continue
        middle = _middles(v, u, cv2.GaussianBlur(inside.astype(np.float32), (0, 0), AROUND_PX / 2))
        corner = middle - HALF_PIECE_PX
        fits = np.all((corner >= 0) & (corner + side <= np.array(near.shape)), axis=1)
        corner = corner[fits]
        masks = sliding_window_view(near, (side, side))[corner[:, 0], corner[:, 1]]
        if len(corner):
            yield Outline(int(number), corner + np.array([rows.start, columns.start]), masks)


def _middles(v: NDArray[np.intp], u: NDArray[np.intp], inside: Plane) -> NDArray[np.int64]:
    """Return the middles (n, 2) of the squares of an outline's pixels in which it runs across the columns."""
    keys = (v // CELL_PX) * (inside.shape[1] // CELL_PX + 1) + u // CELL_PX
    _, piece = np.unique(keys, return_inverse=True)
    along, across = (np.gradient(inside, axis=axis)[v, u] for axis in (0, 1))
    count, sum_v, sum_u, along, across = (
        np.bincount(piece, weights) for weights in (None, v, u, along.astype(float), across.astype(float))
    )
    keep = (count >= MIN_EDGE_PIXELS) & (np.abs(along) >= MIN_ACROSS * np.hypot(along, across))
    order = np.flatnonzero(keep)[np.argsort(-count[keep], kind="stable")]
    middles = np.stack([sum_v[order] / count[order], sum_u[order] / count[order]], axis=1)
    is_apart = np.ones(len(middles), np.bool_)
    for k in range(1, len(middles)):  # pieces that overlap would count twice
        is_apart[k] = np.all(np.abs(middles[:k][is_apart[:k]] - middles[k]).max(axis=1) >= PIECES_APART_PX)
    return middles[is_apart].astype(np.int64)
