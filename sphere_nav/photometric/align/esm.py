"""READ FIRST. Direct registration of one image with one or several references (M15 sections 2 and 5.1).

Coarse to fine: choose the salient pixels that the camera sees, then descend - warp and compare, weigh and sum, solve,
update - until the increments are small; at the end judge.
"""

from __future__ import annotations

from collections.abc import Sequence

from sphere_nav.geometry import SE3, FrameMotion
from sphere_nav.photometric.align.alignment import Alignment
from sphere_nav.photometric.align.judgement import judge
from sphere_nav.photometric.align.overlap import image_overlap
from sphere_nav.photometric.align.problem import MAX_VIEWS, Descent, Problem, State
from sphere_nav.photometric.params import RegistrationParams
from sphere_nav.photometric.pixels.pyramid import Pyramid
from sphere_nav.photometric.pixels.reference import View


def register(
    pyramid: Pyramid,
    views: Sequence[View],
    T_world_camera: SE3,
    params: RegistrationParams | None = None,
    motion: FrameMotion | None = None,
) -> Alignment:
    """Align an image with references that it overlaps, from a first guess of its pose (eq. 4-8, 18-19, 30-35).

    Several references are aligned at once and share `max_pixels` (section 5.1.3). `motion` is that within a frame of a
    rolling shutter; it follows the pose from level to level, and once more at the finest. Raises ValueError without
    views, and for more than `MAX_VIEWS`.
    """
    params = params or RegistrationParams()
    _check(views)
    state, iterations = State.start(T_world_camera, len(views)), 0
    coarsest = min(params.pyramid.coarsest, len(pyramid.levels) - 1)
    finest = min(params.pyramid.finest, coarsest)
    indices = [*range(coarsest, finest - 1, -1), *([finest] if motion is not None else [])]
    for index in indices:
        problem = Problem.choose_pixels(pyramid.levels[index], views, state.T_world_camera, params, motion)
        limit = params.max_iterations_fine if index == finest else params.max_iterations_coarse
        descent = problem.descend(state, limit)
        state, iterations = descent.state, iterations + descent.iterations
    overlap = image_overlap(pyramid, views, state.T_world_camera)
    return judge(problem, descent, iterations, overlap, params)


def evaluate(
    pyramid: Pyramid, views: Sequence[View], T_world_camera: SE3, params: RegistrationParams | None = None
) -> Alignment:
    """Return what `register` would report at a pose without moving it; ValueError as there."""
    params = params or RegistrationParams()
    _check(views)
    problem = Problem.choose_pixels(pyramid.levels[0], views, T_world_camera, params)
    stay = Descent(State.start(T_world_camera, len(views)), 0, 0.0, is_determined=True)
    return judge(problem, stay, 0, image_overlap(pyramid, views, T_world_camera), params)


def _check(views: Sequence[View]) -> None:
    if not 1 <= len(views) <= MAX_VIEWS:
        raise ValueError(f"views: expected at least one reference and at most {MAX_VIEWS}, found {len(views)}")
