"""At which headings, and in which key sphere, does an image look as there, whatever the light?

Grey levels change with the light, and so do the features that are found; where edges run does not. Image and sphere are
drawn on one grid of azimuth and elevation, on which an upright camera that turns moves along the rows. The view is cut
into cells, and each is compared with the gradient directions of the sphere at all turns (template matching); as the
camera stands beside the middle of the sphere, each cell may lie somewhat beside where the turn puts it (deformable
parts, Felzenszwalb et al. 2010). The mean over the cells says how alike a heading is; it ranks, and proves nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import SE3, Camera, Spherical
from sphere_nav.geometry.arrays import Array, Floats
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.spheres.appearance.kernels import score_turns
from sphere_nav.spheres.constants import (
    CELL_REACH,
    CELL_SIDE,
    GRID_WIDTH,
    MAX_ELEVATION,
    MIN_CELL_EDGES,
    SOFT_GRADIENT,
    STRONG_SHARE,
)
from sphere_nav.spheres.sphere import Sphere

GRID = Spherical(GRID_WIDTH, GRID_WIDTH // 2)
TURN_RAD = 2.0 * np.pi / GRID_WIDTH


@dataclass(frozen=True, eq=False)
class PartedView:
    """The stronger edges of an image on the grid, at heading 0, and the cell of each."""

    row: NDArray[np.int32]
    column: NDArray[np.int32]
    direction: Floats
    cell: NDArray[np.int32]
    norm: Floats  # (cells,): what a cell's score is at most


class Heading(NamedTuple):
    """A yaw of the camera in an upright sphere, and how alike the view is there, -1...1."""

    yaw: float
    score: float


def draw_sphere(sphere: Sphere) -> Floats:
    """Return the panorama of a sphere, whole or partial; a small one does.

    Its gradient directions on the grid, (2, H, W): shorter where faint, 0 where nothing is known.
    """
    return _draw(sphere.gray, sphere.camera, SE3.identity())[0]


def cut_view(image: NDArray[Any], camera: Camera, T_level_camera: SE3) -> PartedView:
    """Return the stronger edges of a grey image (H, W) of any camera; `T_level_camera`: how it is tilted."""
    directions, strength = _draw(image, camera, T_level_camera)
    known = strength > 0.0
    limit = np.quantile(strength[known], 1.0 - STRONG_SHARE) if known.any() else np.inf
    row, column = (axis.astype(np.int32) for axis in np.nonzero(known & (strength >= limit)))
    _, cell = np.unique(row // CELL_SIDE * GRID_WIDTH + column // CELL_SIDE, return_inverse=True)
    count = np.bincount(cell)
    kept = count[cell] >= MIN_CELL_EDGES
    row, column, (_, cell) = row[kept], column[kept], np.unique(cell[kept], return_inverse=True)
    direction = np.ascontiguousarray(directions[:, row, column].T)
    square, count = np.bincount(cell, np.sum(direction**2, axis=1)), np.bincount(cell)
    return PartedView(row, column, direction, cell.astype(np.int32), np.sqrt(square * count).astype(np.float32))


def rank_headings(view: PartedView, panorama: Floats, count: int) -> list[Heading]:
    """Return the likeliest headings of a view in one sphere, the likeliest first, all of them apart.

    A turn is as likely anywhere within the reach of its cells; where the middle one of them lies is the heading.
    """
    by_cell, found = _compare(view, panorama), list[Heading]()
    likeness, beside = _within_reach(by_cell), np.arange(-CELL_REACH[0], CELL_REACH[0] + 1)
    for _ in range(count):
        turn = int(np.argmax(likeness))
        if not np.isfinite(likeness[turn]):
            break
        shifts = beside[np.argmax(by_cell[:, (turn + beside) % GRID_WIDTH], axis=1)]
        found.append(Heading(-(turn + float(np.median(shifts))) * TURN_RAD, float(likeness[turn])))
        likeness[np.arange(turn - CELL_SIDE, turn + CELL_SIDE + 1) % GRID_WIDTH] = -np.inf
    return found


def score_headings(view: PartedView, panorama: Floats) -> Floats:
    """Return how alike a view is (W,) when it is turned by so many columns to the right; -inf for one without edges."""
    return _within_reach(_compare(view, panorama))


def _compare(view: PartedView, panorama: Floats) -> Floats:
    """Return how alike each cell is (cells, W), turned by so many columns, a row or two above or below."""
    scores = np.zeros((len(view.norm), 2 * CELL_REACH[1] + 1, GRID_WIDTH), np.float32)
    score_turns(view.row, view.column, view.direction, view.cell, CELL_REACH[1], panorama, scores)
    return np.asarray(scores.max(axis=1) / view.norm[:, None])


def _within_reach(by_cell: Floats) -> Floats:
    """Return how alike a view is (W,) whose cells may each lie a few columns beside their place."""
    from scipy.ndimage import maximum_filter1d  # what only reads bags does without it

    if not len(by_cell):
        return np.full(GRID_WIDTH, -np.inf, np.float32)
    return np.asarray(np.mean(maximum_filter1d(by_cell, 2 * CELL_REACH[0] + 1, axis=1, mode="wrap"), axis=0))


def _draw(image: NDArray[Any], camera: Camera, T_level_camera: SE3) -> tuple[Floats, Floats]:
    """Return directions (2, H, W) and strength (H, W) of the gradients on the grid, both 0 where the image is not."""
    small, camera = _shrink(np.asarray(image, np.float32), camera)
    pixels, is_seen = camera.project(_rays() @ T_level_camera.rotation)
    u, v = np.moveaxis(np.nan_to_num(pixels, nan=-1.0), -1, 0).astype(np.float32)
    border = cv2.BORDER_WRAP if camera.is_whole else cv2.BORDER_REPLICATE
    gray = cv2.remap(small, u, v, cv2.INTER_LINEAR, borderMode=border)
    gray = np.where(is_seen & np.isfinite(gray), gray, np.nan)
    along, across = np.roll(gray, -1, axis=1) - np.roll(gray, 1, axis=1), np.full_like(gray, np.nan)
    across[1:-1] = gray[2:] - gray[:-2]
    strength = np.hypot(along, across)
    strength[np.isnan(strength)] = 0.0
    directions = np.nan_to_num(np.stack([along, across]) / (strength + SOFT_GRADIENT))
    directions[:, strength == 0.0] = 0.0
    return directions.astype(np.float32), strength.astype(np.float32)


@lru_cache(1)
def _rays() -> Array:
    """Return the unit rays (H, W, 3) of the grid, without its poles."""
    rays = pixel_rays(GRID)
    return rays[np.abs(rays[:, 0, 2]) < np.sin(MAX_ELEVATION)]


def _shrink(image: Floats, camera: Camera) -> tuple[Floats, Camera]:
    """Return the image halved while it is finer than the grid by more than a half octave."""
    while camera.pixels_per_radian > np.sqrt(2.0) * GRID.pixels_per_radian and min(image.shape) >= 2 * CELL_SIDE:
        camera = camera.halve()
        image = cv2.resize(
            image[: 2 * camera.height, : 2 * camera.width], (camera.width, camera.height), interpolation=cv2.INTER_AREA
        )
    return image, camera


def warm_up() -> None:
    """Compile what compares, on a sphere too small to cost anything."""
    camera = Spherical(32, 16)
    image = np.random.default_rng(0).integers(1, 255, (16, 32)).astype(np.uint8)
    view = cut_view(image, camera, SE3.identity())
    score_headings(view, draw_sphere(Sphere(image, np.full(image.shape, 5.0, np.float32), camera)))
