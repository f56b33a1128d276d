"""READ FIRST for the depth camera of an RGB-D camera: where it sits beside the image's, from pairs of a drive.

The points of each frame, placed by the pose of the depth camera, are compared in its own image and in that of the other
frame (M15 eq. 4, 33-35): where depth and image do not belong together, no motion explains both. The pose of the depth
camera is shared by all pairs; motion, gain and bias of each are its own and are eliminated (`elimination.py`), from
coarse images to fine ones. The scale of depth cannot be known so: it scales the motion alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

from rig_calibration.constants import DEPTH_FLOOR, DEPTH_SIGMA, DEPTH_STEPS, FALSE_ALARM, MIN_DEPTH_STEP
from rig_calibration.drive.depth_pair import DepthPair, differentiate_pair
from rig_calibration.drive.drive_image import ImageState, weigh_part
from rig_calibration.drive.refinement import Refined, estimate_shared
from sphere_nav.estimation.elimination import Elimination
from sphere_nav.estimation.gates import squared_mahalanobis
from sphere_nav.geometry import SE3, Camera
from sphere_nav.geometry.arrays import Array

NAMES = ("x", "y", "z", "rx", "ry", "rz")
MIN_PAIRS = len(NAMES) + 2  # their scatter is the covariance


@dataclass(frozen=True, eq=False)
class RefinedDepth(Refined):
    """The pose of the depth camera, with the covariance (6, 6) of a step exp(step) T_image_depth."""

    T_image_depth: SE3

    def contradicts(self, T_image_depth: SE3) -> bool:
        """Say whether another pose is refused at FALSE_ALARM (Hotelling's T^2: the pairs tell their own scatter)."""
        off, count, p = (self.T_image_depth @ T_image_depth.inverse()).log(), len(self.states), len(NAMES)
        squared = squared_mahalanobis(off, self.covariance)
        return bool(fdtrc(p, count - p, squared * (count - p) / (p * (count - 1))) < FALSE_ALARM)


def refine_depth_pose(
    pairs: Sequence[DepthPair],
    camera: Camera,
    T_image_depth: SE3,
    T_known: SE3 | None = None,
    levels: Sequence[int] = (3, 2, 1, 0),
) -> RefinedDepth:
    """Estimate the pose of the depth camera; `T_image_depth` is where to start, `levels` of the pyramids are used.

    `T_known` is what was known beforehand, if that is not where to start. ValueError with fewer pairs than MIN_PAIRS.
    """
    if len(pairs) < MIN_PAIRS:
        raise ValueError(
            f"drive: expected at least {MIN_PAIRS} pairs of images with motion between, found {len(pairs)}"
        )
    known, cameras = T_known or T_image_depth, [camera]
    while len(cameras) < len(pairs[0].first.levels):
        cameras.append(cameras[-1].halve())

    def linearize(T: SE3, states: Sequence[ImageState], level: int) -> Elimination:
        both = zip(pairs, states, strict=True)
        parts = [weigh_part(*differentiate_pair(pair, state, T, cameras[level], level)) for pair, state in both]
        return Elimination(parts, DEPTH_SIGMA, (T @ known.inverse()).log())

    def move(T: SE3, step: Array) -> SE3:
        return SE3.exp(step) @ T

    used = [level for level in levels if level < len(cameras)]  # a small image has fewer
    states = [ImageState(pair.T_second_first) for pair in pairs]
    T_image_depth, states = estimate_shared(T_image_depth, states, used, linearize, move, DEPTH_STEPS, MIN_DEPTH_STEP)
    last = linearize(T_image_depth, states, used[-1])
    covariance = last.covariance() + np.diag(DEPTH_FLOOR**2)
    return RefinedDepth(NAMES, DEPTH_SIGMA, covariance, tuple(states), last.num_pixels, last.sigma, T_image_depth)
