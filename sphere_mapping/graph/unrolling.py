"""Spheres of a camera with a rolling shutter: what motion warped is unrolled by the motion that is found."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from sphere_mapping.graph.motion import MotionModel
from sphere_mapping.graph.registration import PreparedSphere
from sphere_nav.photometric import Alignment, RegistrationParams
from sphere_nav.spheres.sphere import Sphere

Array = NDArray[np.float64]
Unroll: TypeAlias = Callable[[Array], Sphere]  # velocity (6,) (v, omega) per second of the sphere -> sphere

MAX_PASSES = 3  # each leaves about half of the error of the velocity
STILL = 0.01  # m/s and rad/s, a change of velocity that warps nothing: 0.1 px of 500 px/rad in 20 ms


def align_unrolled(
    unroll: Unroll,
    stamp_ns: int,
    motion: MotionModel,
    params: RegistrationParams,
    align: Callable[[PreparedSphere], Alignment],
) -> tuple[PreparedSphere, Alignment]:
    """Align a sphere as warped by the expected motion, and again by the motion that was found, until they agree."""
    velocity = motion.velocity()
    for _ in range(MAX_PASSES):
        current = PreparedSphere(unroll(velocity), params)
        alignment = align(current)
        if not alignment.is_converged:
            break
        expected, velocity = velocity, motion.velocity_to(alignment.T_world_camera, stamp_ns)
        if np.linalg.norm(velocity - expected) < STILL:
            break
    return current, alignment
