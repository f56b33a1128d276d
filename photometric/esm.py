"""READ FIRST. Direct registration of one image with one or several references (M15 sections 2 and 5.1).

Coarse to fine: choose the salient pixels that the camera sees, then iterate - warp and compare, weigh and sum,
solve, update - until the increments are small; at the end judge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from photometric.alignment import Alignment
from photometric.judgement import judge
from photometric.overlap import image_overlap
from photometric.params import RegistrationParams
from photometric.problem import Problem, State
from photometric.pyramid import Pyramid
from photometric.reference import View
from sphere_geometry import SE3


def register(
    pyramid: Pyramid,
    views: Sequence[View],
    T_world_camera: SE3,
    params: RegistrationParams | None = None,
) -> Alignment:
    """Align an image with references that it overlaps, from a first guess of its pose (eq. 4-8, 18-19, 30-35).

    Several references are aligned at once and share `max_pixels` (section 5.1.3). Raises ValueError without views.
    """
    params = params or RegistrationParams()
    if not views:
        raise ValueError("views: expected at least one reference, found none")
    state = State.start(T_world_camera, len(views))
    iterations = 0
    coarsest = min(params.pyramid.coarsest, len(pyramid.levels) - 1)
    finest = min(params.pyramid.finest, coarsest)
    for index in range(coarsest, finest - 1, -1):
        problem = Problem.choose_pixels(pyramid.levels[index], views, state.T_world_camera, params)
        limit = params.max_iterations_fine if index == finest else params.max_iterations_coarse
        descent = _descend(problem, state, limit, params)
        state, iterations = descent.state, iterations + descent.iterations
    overlap = image_overlap(pyramid, views, state.T_world_camera)
    return judge(problem, state, iterations, descent.motion, overlap, params)


@dataclass(frozen=True)
class Descent:
    """Where one level ended; `motion` is the last increment in pixels of the level."""

    state: State
    iterations: int
    motion: float


def _descend(problem: Problem, state: State, limit: int, params: RegistrationParams) -> Descent:
    """Iterate at one level until the increment moves the image less than `min_step` (eq. 6-7)."""
    motion = 0.0
    for iteration in range(limit):
        step = problem.step(state)
        if step is None:  # too few pixels or no texture: `judge` says which
            return Descent(state, iteration, motion)
        state = state.moved(step)
        motion = problem.image_motion(step)
        if motion < params.min_step:
            return Descent(state, iteration + 1, motion)
    return Descent(state, limit, motion)
