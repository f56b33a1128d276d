"""How well the images determine the rig: standard deviations from the information, and which axes stay open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rig_calibration.boards.bundle import SHARED, AdjustmentProblem, RigState, information
from rig_calibration.constants import (
    MAX_POSITION_STD_M,
    MAX_ROTATION_STD_DEG,
    OPEN_EIGENVALUE,
    OPEN_FACTOR,
    OPEN_SHARE,
)
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.lens import NUM_LENS

AXES = ("x (forward)", "y (left)", "z (up)", "roll (about x)", "pitch (about y)", "yaw (about z)")
REMEDY = "tilt the rig (roll and pitch) in front of the boards, or let neighbouring cameras see one board at once"


@dataclass(frozen=True, eq=False)
class Spread:
    """Covariances of the adjustment: of lenses (C, 12, 12) and of poses (C, 6, 6), inf on axes that stay open.

    Poses are along and about the axes of the rig.
    """

    noise_px: float
    lenses: Array
    poses: Array

    @property
    def lens_std(self) -> Array:
        """Standard deviations (C, 12) of the lens parameters."""
        return np.sqrt(np.diagonal(self.lenses, axis1=1, axis2=2))

    @property
    def pose_std(self) -> Array:
        """Standard deviations (C, 6) along and about the axes of the rig, in metres and radians."""
        return np.sqrt(np.diagonal(self.poses, axis1=1, axis2=2))


def spread(problem: AdjustmentProblem, state: RigState, errors: Array, kept: Array) -> Spread:
    """Return the covariances at a solution with residuals (N, 2); the noise is estimated from these."""
    reduced = information(problem, state, kept)
    free = np.flatnonzero(np.diag(reduced) > 0)
    num_poses = len(np.unique(problem.seen.instant[problem.seen.view[kept > 0]]))
    num_left = max(2 * int(np.count_nonzero(kept)) - len(free) - 6 * num_poses, 1)
    noise = float(np.sqrt(np.sum(errors[kept > 0] ** 2) / num_left))
    covariance = np.zeros_like(reduced)
    covariance[np.ix_(free, free)] = noise**2 * _inverse(reduced[np.ix_(free, free)])
    firsts = range(0, SHARED * len(state.lenses), SHARED)
    own = np.stack([covariance[first : first + SHARED, first : first + SHARED] for first in firsts])
    return Spread(noise, own[:, :NUM_LENS, :NUM_LENS], own[:, NUM_LENS:, NUM_LENS:])


def warnings(names: Sequence[str], found: Spread) -> list[str]:
    """Return one line for every axis of a camera that is not, or only weakly, determined."""
    limits = np.repeat([MAX_POSITION_STD_M, np.radians(MAX_ROTATION_STD_DEG)], 3)
    lines = []
    for name, std in zip(names, found.pose_std, strict=True):
        for axis in np.flatnonzero(std > limits):
            how = "cannot be" if std[axis] > OPEN_FACTOR * limits[axis] else "is weakly"
            lines.append(f"{name}: {AXES[axis]} {how} observed ({_size(float(std[axis]), int(axis))})")
    return [*lines, REMEDY] if lines else []


def _size(std: float, axis: int) -> str:
    if not np.isfinite(std):
        return "nothing in the images depends on it"
    return f"standard deviation {1e3 * std:.1f} mm" if axis < 3 else f"standard deviation {np.degrees(std):.2f}°"


def _inverse(matrix: Array) -> Array:
    """Return the inverse of an information matrix, inf on the diagonal where it is singular."""
    scale = 1.0 / np.sqrt(np.diag(matrix))
    eigenvalues, vectors = np.linalg.eigh(matrix * scale * scale[:, None])
    is_open = eigenvalues < OPEN_EIGENVALUE
    inverse = (vectors[:, ~is_open] / eigenvalues[~is_open]) @ vectors[:, ~is_open].T * scale * scale[:, None]
    share = np.sum(vectors[:, is_open] ** 2, axis=1)
    lost = np.flatnonzero(share > OPEN_SHARE)
    inverse[lost, lost] = np.inf
    return inverse
