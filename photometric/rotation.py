"""Rotation between two images of one camera, from the coarsest level alone (M15 section 5.2, eq. 20)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from photometric.params import RegistrationParams
from photometric.problem import Problem, State
from photometric.pyramid import Pyramid
from photometric.reference import Reference, View, prepare_level
from photometric.rig import RigImage
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
    view = View(Reference((pixels,)), SE3.identity())
    problem = Problem.choose_pixels(level, [view], SE3.identity(), params)
    descent = problem.descend(State.start(SE3.identity(), 1), MAX_ITERATIONS, is_rotation=True)
    return descent.state.T_world_camera if descent.is_determined else SE3.identity()


def register_rig_rotation(
    now: Sequence[RigImage], before: Sequence[RigImage], params: RegistrationParams | None = None
) -> SE3 | None:
    """Return T_before_now of the body of several cameras by the first that has both images; None where none has."""
    earlier = {image.name: image for image in before}
    for image in now:
        if image.name in earlier:
            T_before_now = register_rotation(image.pyramid, earlier[image.name].pyramid, params)
            R = np.eye(3) if image.T_body_camera is None else image.T_body_camera.rotation
            return SE3.from_parts(R @ T_before_now.rotation @ R.T, np.zeros(3))
    return None
