"""Rotation between two images of one camera, from the coarsest level alone (M15 section 5.2, eq. 20)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import SE3, Camera
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.camera import pixel_grid
from sphere_nav.photometric.align.descent import kernels
from sphere_nav.photometric.align.iteration.kernels import BLOCK, GRAY, SIDE
from sphere_nav.photometric.align.problem import AlignmentState, Problem
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.photometric.constants import MIN_VIEW_PIXELS, ROTATION_ITERATIONS, TURN_PIXELS
from sphere_nav.photometric.params import RegistrationParams
from sphere_nav.photometric.pixels.pyramid import Pyramid
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
    level, earlier = now.levels[-1], before.levels[-1]
    (rows, columns), rays = _sample(earlier.camera)
    blocks = rays.copy()
    blocks.reshape(-1, BLOCK // SIDE, SIDE)[:, GRAY // SIDE] = earlier.image[rows, columns + earlier.pad]
    facts, pieces = np.empty(kernels.NUM_FACTS), np.empty((kernels.NUM_PIECES, kernels.NUM_SUMS))
    T = np.zeros((3, 4))
    T[:, :3] = R_before_now.T
    camera, image = level.kernel_camera, level.samples
    kernels.examine(blocks, T, camera, image, 1.0, 0.0, 1.0, 1.0, facts, pieces)  # of all pixels alike
    number = facts[kernels.NUM_VISIBLE]
    if number < MIN_VIEW_PIXELS:
        return None
    reference, current, product, square_reference, square_current = facts[kernels.SUM_REFERENCE :].tolist()
    norm = (square_reference - reference**2 / number) * (square_current - current**2 / number)
    return float((product - reference * current / number) / norm**0.5) if norm > 0.0 else None


@lru_cache(maxsize=16)
def _sample(camera: Camera) -> tuple[tuple[NDArray[np.int64], NDArray[np.int64]], NDArray[np.float32]]:
    """Return rows and columns (B, SIDE) of pixels of a camera, and blocks (B * BLOCK,) with their rays; NaN: none."""
    step = max(1, int(np.sqrt(camera.width * camera.height / TURN_PIXELS)))
    grid = pixel_grid(camera)[step // 2 :: step, step // 2 :: step].reshape(-1, 2)
    number = -(-len(grid) // SIDE)
    pixels, rays = np.zeros((number * SIDE, 2), np.int64), np.full((number * SIDE, 3), np.nan, np.float32)
    pixels[: len(grid)], rays[: len(grid)] = grid, camera.unproject(grid)
    blocks = np.zeros((number, BLOCK // SIDE, SIDE), np.float32)
    blocks[:, :3] = rays.reshape(number, SIDE, 3).swapaxes(1, 2)
    columns, rows = pixels.T.reshape(2, number, SIDE)
    return (rows, columns), blocks.reshape(-1)
