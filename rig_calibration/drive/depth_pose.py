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
from scipy.stats import f

from rig_calibration.drive.depth_pair import SHARED, DepthPair, PairState, linearize_pair
from sphere_nav.estimation.elimination import Elimination, Part
from sphere_nav.estimation.gates import squared_mahalanobis
from sphere_nav.geometry import SE3, Camera
from sphere_nav.geometry.arrays import Array

NAMES = ("x", "y", "z", "rx", "ry", "rz")
PRIOR_SIGMA = np.array([0.05, 0.05, 0.05, *np.radians([3.0, 3.0, 3.0])])  # of a camera that nobody calibrated, m, rad
FLOOR = np.array([0.001, 0.001, 0.001, *np.radians([0.03, 0.03, 0.03])])  # what sampling leaves however many pairs
UNOBSERVED = 0.5  # of the deviation known beforehand: more is left than the drive has told
MIN_PAIRS = SHARED + 2  # their scatter is the covariance
FALSE_ALARM = 1e-3  # of drives whose depth sits where it is said to
MAX_STEPS = 15  # at a level
MIN_STEP = 0.05  # of the standard deviations, below which a level is done


@dataclass(frozen=True, eq=False)
class RefinedDepth:
    """What a drive tells of a depth camera: its pose, and the covariance (6, 6) of a step exp(step) T_image_depth."""

    T_image_depth: SE3
    covariance: Array
    states: tuple[PairState, ...]
    num_pixels: int
    residual: float  # robust standard deviation in grey levels

    @property
    def deviations(self) -> dict[str, float]:
        """Standard deviations, m and rad."""
        return dict(zip(NAMES, np.sqrt(np.diagonal(self.covariance)).tolist(), strict=True))

    @property
    def unobserved(self) -> tuple[str, ...]:
        """Components that the drive does not tell: their deviation is about what it was before."""
        sigma = np.sqrt(np.diagonal(self.covariance))
        return tuple(name for name, is_left in zip(NAMES, sigma > UNOBSERVED * PRIOR_SIGMA, strict=True) if is_left)

    def contradicts(self, T_image_depth: SE3) -> bool:
        """Say whether another pose is refused at FALSE_ALARM (Hotelling's T^2: the pairs tell their own scatter)."""
        off, count = (self.T_image_depth @ T_image_depth.inverse()).log(), len(self.states)
        squared = squared_mahalanobis(off, self.covariance)
        return bool(f.sf(squared * (count - SHARED) / (SHARED * (count - 1)), SHARED, count - SHARED) < FALSE_ALARM)


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
    known, states = T_known or T_image_depth, [PairState(pair.T_second_first) for pair in pairs]
    cameras = [camera]
    while len(cameras) < len(pairs[0].first.levels):
        cameras.append(cameras[-1].halve())
    for level in (level for level in levels if level < len(cameras)):  # a small image has fewer
        for _ in range(MAX_STEPS):
            _, reduced = _linearize(pairs, states, T_image_depth, known, cameras[level], level)
            shared, own, size = reduced.step()
            T_image_depth = SE3.exp(shared) @ T_image_depth
            states = [state.moved(step) for state, step in zip(states, own, strict=True)]
            if size < MIN_STEP:
                break
    parts, reduced = _linearize(pairs, states, T_image_depth, known, cameras[level], level)
    covariance = reduced.covariance() + np.diag(FLOOR**2)
    residual = float(np.median([part.sigma for part in parts]))
    return RefinedDepth(T_image_depth, covariance, tuple(states), sum(part.num_pixels for part in parts), residual)


def _linearize(
    pairs: Sequence[DepthPair], states: Sequence[PairState], T: SE3, T_known: SE3, camera: Camera, level: int
) -> tuple[list[Part], Elimination]:
    parts = [linearize_pair(pair, state, T, camera, level) for pair, state in zip(pairs, states, strict=True)]
    return parts, Elimination(parts, PRIOR_SIGMA, (T @ T_known.inverse()).log())
