"""Rotation between two images of one camera, from the coarsest level alone (M15 section 5.2, eq. 20)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from photometric.normal_equations import ViewSolver
from photometric.params import RegistrationParams
from photometric.problem import Problem, State
from photometric.pyramid import Pyramid
from photometric.reference import prepare_level
from sphere_geometry import SE3

MAX_ITERATIONS = 10  # M15 section 6.1


def register_rotation(now: Pyramid, before: Pyramid, params: RegistrationParams | None = None) -> SE3:
    """Return T_before_now, a pure rotation, between two images of the same camera; identity where nothing is seen.

    At the coarsest level rotation dominates: every pixel is taken as infinitely far.
    """
    params = params or RegistrationParams()
    level = now.levels[-1]
    everywhere_far = np.full((level.camera.height, level.camera.width), np.inf, np.float32)
    pixels = prepare_level(before.levels[-1], everywhere_far, params.far)
    problem = Problem((ViewSolver(pixels, level),), (SE3.identity(),), level, params)
    state = State.start(SE3.identity(), 1)
    for _ in range(MAX_ITERATIONS):
        step = problem.step(state, rotation_only=True)
        if step is None:
            return SE3.identity()
        state = state.moved(replace(step, xi=np.concatenate([np.zeros(3), step.xi[3:]])))
        if problem.image_motion(step) < params.min_step:
            break
    return state.T_world_camera
