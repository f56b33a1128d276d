"""What goes into the filter for one image, and what comes out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mcl_depth.belief.hypotheses import Hypothesis
from mcl_depth.belief.particles import Particles
from mcl_depth.constants import UNMODELED
from mcl_depth.likeness.depth_map import Comparison
from sphere_nav.geometry import SE3, Camera, so3
from sphere_nav.geometry.arrays import PLANAR, Array
from sphere_nav.localization.status import Status


@dataclass(frozen=True)
class Observation:
    """One image. Frame `level`: the camera's centre with the vehicle's axes, levelled: z up, x where it heads.

    `rotation` (3, 3) turns camera axes into those of `level`; `odometry` is its x, y, yaw (3,) at the stamp, or None.
    """

    image: NDArray[Any]  # grey (H, W)
    camera: Camera
    stamp_ns: int
    rotation: Array
    odometry: Array | None = None


@dataclass(frozen=True)
class Belief:
    """What was found out with one image, for whoever wants to look at it."""

    best: Hypothesis  # the likeliest place
    particles: Particles  # weighted, before resampling
    comparison: Comparison
    places: tuple[Hypothesis, ...]  # likely ones, the best first; by the evidence of all images while none is held


@dataclass(frozen=True)
class Estimate:
    """The news of one image; without a trusted pose there is none, without a comparison there is no belief."""

    status: Status
    T_map_level: SE3 | None = None
    covariance: Array | None = None  # (6, 6) of xi = (v, omega) in T_map_level @ exp(xi)
    belief: Belief | None = None


def level_pose(pose: Array, height: float) -> SE3:
    """Return T_map_level from x, y, yaw and the height of the camera in the map."""
    return SE3.from_parts(so3.exp([0.0, 0.0, pose[2]]), [*pose[:2], height])


def pose_covariance(covariance: Array, yaw: float) -> Array:
    """Return the local covariance (6, 6) from that of x, y, yaw (3, 3) in the map's axes, with what particles omit."""
    R = so3.exp([0.0, 0.0, -yaw])
    local = R @ covariance @ R.T
    full = np.zeros((6, 6))
    full[PLANAR] = local
    return full + np.diag(UNMODELED**2)
