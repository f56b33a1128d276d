"""Where views of a sphere mix: strips along the seams. Everywhere else a pixel is one camera's, to the grey level.

A view is drawn in *tiles*, rectangles of what it shows and what strips mix: a camera that shows a pole has a part in
all columns, from the one pole to the other, and a third of these is enough.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.constants import ALONE, CAP_ROWS
from sphere_mapping.acquisition.range.levels import around, halve_image, twice
from sphere_nav.geometry.arrays import Flags, Floats

OUTSIDE = -1  # owner of a pixel that no camera shows


@dataclass(frozen=True)
class Block:
    """Rows and columns of a sphere; columns count on beyond the last one, which wraps around."""

    row: int
    column: int
    height: int
    width: int

    def slices(self, row: int = 0, column: int = 0) -> tuple[slice, slice]:
        """Return its rows and columns in an array that begins at (row, column) and does not wrap around."""
        top, left = self.row - row, self.column - column
        return slice(top, top + self.height), slice(left, left + self.width)

    def at(self, level: int) -> Block:
        """Return the block in a pyramid level."""
        return Block(self.row >> level, self.column >> level, self.height >> level, self.width >> level)

    def cut(self, plane: NDArray) -> NDArray:
        """Return a copy of what the block covers of a plane (H, W, ...)."""
        rows, end, parts = plane[self.row : self.row + self.height], self.column + self.width, []
        place = self.column
        while place < end:  # slices are copied several times as fast as columns one by one
            first = place % rows.shape[1]
            parts.append(rows[:, first : first + end - place])
            place += parts[-1].shape[1]
        return np.concatenate(parts, axis=1)


@dataclass(frozen=True, eq=False)
class Strip:
    """A block of the sphere in which views mix, and the part of it that is shown."""

    block: Block
    shown: Block
    shares: tuple[Share, ...]

    def part(self, share: Share) -> Block:
        """Return the part of the sphere in which a view has a share."""
        first, last = share.columns.start, share.columns.stop
        return Block(self.block.row, self.block.column + first, self.block.height, last - first)


@dataclass(frozen=True, eq=False)
class Share:
    """Columns of a strip's block in which a view by number has a share, and what its bands need around these.

    weights: the share (h >> l, w >> l) in each band, the finest first.
    """

    view: int
    columns: slice
    weights: tuple[Floats, ...]


def strips_of(owner: NDArray[np.int8], number: int, num_bands: int) -> tuple[Strip, ...]:
    """Return the strips of a sphere whose pixels (H, W) belong to views 0 to number - 1."""
    weights = _weights(owner, number, num_bands)
    mixed = _mix(weights)
    margin = 4 << num_bands
    found = []
    for rows in _bands(owner.shape[0], 1 << num_bands):
        for first, last in _runs(np.any(mixed[rows], axis=0), 2 * margin, 1 << num_bands):
            top, bottom = max(rows.start - margin, 0), min(rows.stop + margin, owner.shape[0])
            # one view has a run's ends to itself; a whole round has none
            side = margin if last - first == owner.shape[1] else 0
            block = Block(top, first - side, bottom - top, last - first + 2 * side)
            shown = Block(rows.start, first, rows.stop - rows.start, last - first)
            shares = [share for k in range(number) for share in _shares(k, weights, block, margin)]
            found.append(Strip(block, shown, tuple(shares)))
    return tuple(found)


def _shares(view: int, weights: Sequence[Floats], block: Block, margin: int) -> Iterator[Share]:
    """Yield where a view has a share in a block; weights: as of `_weights`."""
    own = [block.at(level).cut(weight[view]) for level, weight in enumerate(weights)]
    has_share = np.any([np.repeat(weight.any(axis=0), 1 << level) for level, weight in enumerate(own)], axis=0)
    apart = np.zeros(2 * margin + 1, np.bool_)  # a block does not go around
    for first, last in _runs(np.append(has_share, apart), 2 * margin, 1 << (len(own) - 1)):
        first, last = max(first - margin, 0), min(last + margin, block.width)
        parts = (np.ascontiguousarray(weight[:, first >> k : last >> k]) for k, weight in enumerate(own))
        yield Share(view, slice(first, last), tuple(parts))


def _weights(owner: NDArray[np.int8], number: int, num_bands: int) -> list[Floats]:
    """Return the share (views, H >> l, W >> l) of each view in each band: its region, blurred; 1 in all if covered."""
    levels = [np.stack([(owner == k).astype(np.float32) for k in range(number)])]
    for _ in range(num_bands):
        levels.append(np.stack([halve_image(plane, is_whole=True) for plane in levels[-1]]))
    totals = [level.sum(axis=0) for level in levels]
    return [
        np.where(total > 1e-3, level / np.maximum(total, np.float32(1e-3)), np.float32(0.0))
        for level, total in zip(levels, totals, strict=True)
    ]


def _mix(weights: Sequence[Floats]) -> Flags:
    """Return the pixels (H, W) that more than one view has a share in, through any band."""
    found: Flags = np.zeros((0, 0), np.bool_)
    for level in reversed(weights):
        highest = level.max(axis=0)
        here = (highest > 0) & (highest < ALONE)
        if found.size:
            padded = around(twice(found.astype(np.uint8)), 2, is_whole=True)
            here |= cv2.dilate(padded, np.ones((5, 5), np.uint8))[:, 2:-2][: here.shape[0], : here.shape[1]] > 0
        found = here
    return found


def _bands(height: int, align: int) -> Iterator[slice]:
    """Yield the rows of the caps and of what is between."""
    cap = min(CAP_ROWS, height // 4) // align * align
    edges = [0, cap, height - cap, height] if cap else [0, height]
    for first, last in pairwise(edges):
        yield slice(first, last)


def _runs(columns: Flags, gap: int, align: int) -> list[tuple[int, int]]:
    """Return first and last (beyond the last one the columns wrap around) of runs that are farther apart than gap."""
    width = columns.size
    at = np.flatnonzero(columns)
    if at.size == 0:
        return []
    steps = np.diff(np.append(at, at[0] + width))
    breaks = np.flatnonzero(steps > gap)
    if breaks.size == 0:
        return [(0, width)]
    firsts, lasts = at[(breaks + 1) % at.size], at[np.roll(breaks, -1)]
    found = []
    for first, last in zip(firsts, lasts, strict=True):
        begin, end = int(first) // align * align, -(-(int(last) + 1) // align) * align
        found.append((begin, end if end > begin else end + width))
    return found


ROWS = 4  # cells of a tile: as wide as it is needed anywhere in them


def tiles_of(view: int, is_owned: Flags, strips: Sequence[Strip], step: int) -> Iterator[Block]:
    """Yield the rectangles of the sphere in which a view is needed, in multiples of `step`.

    is_owned: (H, W), where the sphere shows the view.
    """
    height, width = (side // step for side in is_owned.shape)
    is_used: Flags = np.asarray(np.any(is_owned.reshape(height, step, width, step), axis=(1, 3)), np.bool_)
    for strip in strips:
        for share in strip.shares:
            if share.view == view:
                part = strip.part(share)
                columns = np.arange(part.column, part.column + part.width, step) // step % width
                is_used[part.row // step : (part.row + part.height) // step, columns] = True
    for top in range(0, height, ROWS):
        used = np.any(is_used[top : top + ROWS], axis=0)
        edges = np.flatnonzero(np.diff(used, prepend=False, append=False))
        for first, last in edges.reshape(-1, 2).tolist():
            yield Block(top * step, first * step, min(ROWS, height - top) * step, (last - first) * step)
