"""Rotation between two images of one camera, from the coarsest level alone (M15 section 5.2, eq. 20); likeness."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import SE3, Camera
from sphere_nav.geometry.arrays import Array, Floats
from sphere_nav.geometry.cameras.camera import pixel_grid
from sphere_nav.photometric.align.descent import kernels
from sphere_nav.photometric.align.iteration.kernels import BLOCK, GRAY, SIDE
from sphere_nav.photometric.align.problem import ROBUST, AlignmentState, Problem, rows_of
from sphere_nav.photometric.align.projection import in_blocks
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.photometric.constants import MIN_VIEW_PIXELS, ROTATION_ITERATIONS, TURN_PIXELS
from sphere_nav.photometric.params import RegistrationParams
from sphere_nav.photometric.pixels.pyramid import Level, Pyramid
from sphere_nav.photometric.pixels.reference import Reference, View, prepare_level


def register_rotation(now: Pyramid, before: Pyramid, params: RegistrationParams | None = None) -> SE3:
    """Return T_before_now, a pure rotation, between two images of the same camera; identity where nothing is seen.

    At the coarsest level rotation dominates: every pixel is taken as infinitely far.
    """
    params = params or RegistrationParams()
    level = now.levels[-1]
    everywhere_far = np.full((level.camera.height, level.camera.width), np.inf, np.float32)
    pixels = prepare_level(before.levels[-1], everywhere_far, params.far)
    image = RigImage(Pyramid((level,)), views=(View(Reference((pixels,)), SE3.identity()),))
    problem = Problem.choose_pixels([image], 0, SE3.identity(), params)
    descent = problem.descend(AlignmentState.start(SE3.identity(), 1), ROTATION_ITERATIONS, is_rotation=True)
    return descent.state.T_world_body if descent.is_determined else SE3.identity()


def correlation_after_turn(now: Pyramid, before: Pyramid, R_before_now: Array) -> float | None:
    """Return the correlation -1...1 of an image with an earlier one of the same camera, turned; None for too little.

    A few hundred pixels of the coarsest level are compared: a tenth of the time that `register_rotation` takes.
    """
    earlier = before.levels[-1]
    (column, row), rays = _sample(earlier.camera)
    pixels = np.zeros((BLOCK // SIDE, len(row)), np.float32)
    pixels[:3], pixels[GRAY // SIDE] = rays, earlier.image[row, column + earlier.pad]
    found, number = correlate(in_blocks(pixels), SE3.from_parts(R_before_now.T, np.zeros(3)), now.levels[-1])
    return found if number >= MIN_VIEW_PIXELS else None


def correlate(blocks: Floats, T_camera_reference: SE3, level: Level) -> tuple[float, int]:
    """Return the correlation -1...1 of pixels with an image from a pose, and of how many; of 0 where nothing varies."""
    facts, pieces = np.empty(kernels.NUM_FACTS), np.empty((kernels.NUM_PIECES, kernels.NUM_SUMS))
    image = level.kernel_camera, level.samples
    kernels.examine(blocks, rows_of(T_camera_reference), *image, 1.0, 0.0, *ROBUST, facts, pieces)
    number = max(int(facts[kernels.NUM_VISIBLE]), 1)
    reference, current, product, square_reference, square_current = facts[kernels.SUM_REFERENCE :].tolist()
    norm = (square_reference - reference**2 / number) * (square_current - current**2 / number)
    return ((product - reference * current / number) / norm**0.5, number) if norm > 0.0 else (0.0, 0)


@lru_cache(maxsize=16)
def _sample(camera: Camera) -> tuple[NDArray[np.int64], Floats]:
    """Return columns and rows (2, N) of pixels of a camera, and their rays (3, N)."""
    step = max(1, int(np.sqrt(camera.width * camera.height / TURN_PIXELS)))
    grid = pixel_grid(camera)[step // 2 :: step, step // 2 :: step].reshape(-1, 2)
    return grid.T.astype(np.int64), camera.unproject(grid).T.astype(np.float32)
