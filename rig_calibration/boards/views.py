"""What was seen: one `BoardView` for a board in an image, and all of them as rows for the adjustment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rig_calibration.boards.board import Board
from sphere_nav.geometry.arrays import Array

Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class BoardView:
    """The corners of one board in one image: their numbers (n,) on the board and where they are, (n, 2) pixels.

    blur_px: standard deviation of the blur of its edges; NaN where nobody measured it.
    """

    camera: str
    instant: str
    board: str
    corners: Indices
    pixels: Array
    blur_px: float = float("nan")

    @property
    def label(self) -> str:
        """Name for reports."""
        return f"{self.camera}/{self.instant}/{self.board}"


@dataclass(frozen=True, eq=False)
class Observations:
    """Corners of all views one below the other, views of a camera next to each other.

    Per view (V,): index of camera, instant and board. Per corner (N,): its view, its point (N, 3) in the board frame
    and its pixel (N, 2).
    """

    camera: Indices
    instant: Indices
    board: Indices
    counts: Indices
    points: Array
    pixels: Array

    @property
    def num_views(self) -> int:
        """Number of views V."""
        return len(self.camera)

    @cached_property
    def rows(self) -> list[slice]:
        """Rows of the corners of each view (V)."""
        ends = np.cumsum(self.counts).tolist()
        return list(map(slice, [0, *ends[:-1]], ends))

    @cached_property
    def view(self) -> Indices:
        """Index of the view of every corner (N,)."""
        return np.repeat(np.arange(self.num_views), self.counts)

    @cached_property
    def camera_slices(self) -> list[tuple[int, slice]]:
        """Rows of the corners of each camera that has any."""
        of_corner = self.camera[self.view]
        found, first, count = np.unique(of_corner, return_index=True, return_counts=True)
        return [(int(c), slice(int(a), int(a + n))) for c, a, n in zip(found, first, count, strict=True)]


def observations(
    camera: Sequence[int],
    instant: Sequence[int],
    board: Sequence[int],
    points: Sequence[Array],
    pixels: Sequence[Array],
) -> Observations:
    """Stack views given by their indices, points (n, 3) and pixels (n, 2); they come sorted by camera."""
    counts = list(map(len, pixels))
    cameras, instants, boards, numbers = (np.asarray(one, dtype=np.intp) for one in (camera, instant, board, counts))
    return Observations(cameras, instants, boards, numbers, np.concatenate(points), np.concatenate(pixels))


def camera_observations(views: Sequence[BoardView], boards: Mapping[str, Board]) -> Observations:
    """Return the views of one camera."""
    zeros, points = [0] * len(views), [boards[view.board].points[view.corners] for view in views]
    return observations(zeros, range(len(views)), zeros, points, [view.pixels for view in views])
