"""READ FIRST. Direct registration of images with their references (M15 sections 2 and 5.1).

Coarse to fine: choose the salient pixels that the cameras see, then descend - warp and compare, weigh and sum, solve,
update - until the increments are small; at the end classify. A single camera is a rig of one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sphere_nav.geometry import SE3, FrameMotion
from sphere_nav.photometric.align.expectation import NO_EXPECTATION, Expectation
from sphere_nav.photometric.align.judgement import Alignment, classify
from sphere_nav.photometric.align.problem import MAX_VIEWS, AlignmentState, Descent, Problem
from sphere_nav.photometric.align.rig import RigImage, image_overlap, share_pixels
from sphere_nav.photometric.params import RegistrationParams
from sphere_nav.photometric.pixels.pyramid import Pyramid
from sphere_nav.photometric.pixels.reference import View


def register_rig(
    images: Sequence[RigImage],
    T_world_body: SE3,
    params: RegistrationParams | None = None,
    motion: FrameMotion | None = None,
    expected: Expectation = NO_EXPECTATION,
) -> Alignment:
    """Align the images of the cameras of a body with references that they overlap, from a first guess of its pose.

    Eq. 4-8, 18-19, 30-35. Several references are aligned at once; the cameras, and the references of each, share
    `max_pixels` (section 5.1.3). Gains and biases come camera by camera. `motion` is that of the body within a frame of
    a rolling shutter; it follows the pose from level to level, and once more at the finest. `expected`: what is known
    of the pose beforehand. Raises ValueError without images, for an image without views, and for one with more than
    `MAX_VIEWS`.
    """
    params = params or RegistrationParams()
    _check(images)
    share, state, iterations = share_pixels(params, len(images)), _start(images, T_world_body), 0
    coarsest = min(params.pyramid.coarsest, max(len(image.pyramid.levels) for image in images) - 1)
    finest = min(params.pyramid.finest, coarsest)
    for index in [*range(coarsest, finest - 1, -1), *([finest] if motion is not None else [])]:
        problem = Problem.choose_pixels(images, index, state.T_world_body, share, motion, expected)
        limit = params.max_iterations_fine if index == finest else params.max_iterations_coarse
        descent = problem.descend(state, limit)
        state, iterations = descent.state, iterations + descent.iterations
    return _judge(images, descent, iterations, params, expected)


def register(
    pyramid: Pyramid,
    views: Sequence[View],
    T_world_camera: SE3,
    params: RegistrationParams | None = None,
    motion: FrameMotion | None = None,
    expected: Expectation = NO_EXPECTATION,
) -> Alignment:
    """Align the image of one camera, as `register_rig` does; pose and motion are those of the camera."""
    return register_rig([RigImage(pyramid, views=tuple(views))], T_world_camera, params, motion, expected)


def evaluate(
    pyramid: Pyramid, views: Sequence[View], T_world_camera: SE3, params: RegistrationParams | None = None
) -> Alignment:
    """Return what `register` would report at a pose without moving it; ValueError as there."""
    params, images = params or RegistrationParams(), [RigImage(pyramid, views=tuple(views))]
    _check(images)
    problem, start = Problem.choose_pixels(images, 0, T_world_camera, params), _start(images, T_world_camera)
    *_, found = problem.compare(start)
    return _judge(images, Descent(start, 0, 0.0, is_determined=True, found=found), 0, params, problem.expected)


def _judge(
    images: Sequence[RigImage], descent: Descent, iterations: int, params: RegistrationParams, expected: Expectation
) -> Alignment:
    """Say what the last descent has found, after so many iterations."""
    T_world_body = descent.state.T_world_body
    overlaps = [image_overlap(image.pyramid.cameras, image.views, image.pose(T_world_body)) for image in images]
    known, _ = expected.pull_at(T_world_body)
    return classify(descent, iterations, float(np.mean(overlaps)), params, known)


def _start(images: Sequence[RigImage], T_world_body: SE3) -> AlignmentState:
    return AlignmentState.start(T_world_body, sum(len(image.views) for image in images))


def _check(images: Sequence[RigImage]) -> None:
    if not images:
        raise ValueError("images: expected at least one, found none")
    for image in images:
        if not 1 <= len(image.views) <= MAX_VIEWS:
            found = len(image.views)
            raise ValueError(f"views: expected at least one reference and at most {MAX_VIEWS}, found {found}")
