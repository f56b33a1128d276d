"""How far estimated poses are from true ones: absolute, relative, lateral and longitudinal errors, consistency."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.se3 import SE3
from sphere_nav.geometry.trajectory import Trajectory

DIRECTION_BASELINE_M = 0.2  # the direction of motion is measured over this way, to both sides
ALIGNMENTS = ("none", "se3", "sim3")


@dataclass(frozen=True)
class Statistics:
    """Of the absolute values of errors."""

    median: float
    rmse: float
    p95: float
    max: float

    @classmethod
    def of(cls, errors: Array) -> Statistics | None:
        """Summarise errors (N,), signed or not; those that are NaN do not count; None if nothing is left."""
        size = np.abs(errors[np.isfinite(errors)])
        if not size.size:
            return None
        rmse = float(np.sqrt(np.mean(size**2)))
        return cls(float(np.median(size)), rmse, float(np.percentile(size, 95)), float(size.max()))


@dataclass(frozen=True, eq=False)
class AbsoluteErrors:
    """Per pose: `translation_m`, `rotation_rad`, signed `lateral_m` (left) and `longitudinal_m` (ahead), all (N,)."""

    translation_m: Array
    rotation_rad: Array
    lateral_m: Array
    longitudinal_m: Array


@dataclass(frozen=True, eq=False)
class RelativeErrors:
    """Per pair of poses `length_m` (N,) of driven way apart: error of the motion between them."""

    length_m: Array
    translation_m: Array
    rotation_rad: Array


def align(estimate: Trajectory, truth: Trajectory, kind: str) -> tuple[SE3, float]:
    """Return `T_truth_estimate` and scale that bring the positions together best (Umeyama 1991), by `kind`.

    The trajectories are paired pose by pose. Kind: 'none', 'se3' (rigid) or 'sim3' (rigid and scale).
    """
    if kind not in ALIGNMENTS:
        raise ValueError(f"align: expected one of {', '.join(ALIGNMENTS)}, found {kind!r}")
    if kind == "none":
        return SE3.identity(), 1.0
    source, target = estimate.positions, truth.positions
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    U, sizes, Vt = np.linalg.svd((target - target_mean).T @ (source - source_mean) / len(source))
    if len(source) < 3 or sizes[1] < 1e-9 * max(sizes[0], 1e-30):
        raise ValueError(f"align: expected at least 3 poses that are not on one line, found {len(source)} poses")
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(U) * np.linalg.det(Vt))])
    R = (U * signs) @ Vt
    variance = np.mean(np.sum((source - source_mean) ** 2, axis=-1))
    scale = float(sizes @ signs / variance) if kind == "sim3" else 1.0
    return SE3.from_parts(R, target_mean - scale * R @ source_mean), scale


def absolute_errors(estimate: Trajectory, truth: Trajectory, directions: Array) -> AbsoluteErrors:
    """Compare pose by pose; `directions` (N, 2) as `directions_of_motion` gives them for the truth."""
    translation, rotation = truth.T_map_body.distance(estimate.T_map_body)
    error = (estimate.positions - truth.positions)[:, :2]
    longitudinal = np.sum(error * directions, axis=-1)
    lateral = error[:, 1] * directions[:, 0] - error[:, 0] * directions[:, 1]
    return AbsoluteErrors(translation, rotation, lateral, longitudinal)


def directions_of_motion(trajectory: Trajectory) -> Array:
    """Return the horizontal unit direction (N, 2) in which the body moves at each pose.

    It is taken between the positions one baseline before and after along the way, so that it is also known at
    standstill. Where these agree (no motion at all, or a cusp) it is the direction of the body's x axis.
    """
    way = trajectory.distances
    before = np.maximum(np.searchsorted(way, way - DIRECTION_BASELINE_M, side="right") - 1, 0)
    after = np.minimum(np.searchsorted(way, way + DIRECTION_BASELINE_M, side="left"), len(way) - 1)
    motion = (trajectory.positions[after] - trajectory.positions[before])[:, :2]
    is_still = np.linalg.norm(motion, axis=-1) < 0.1 * DIRECTION_BASELINE_M
    motion = np.where(is_still[:, None], trajectory.T_map_body.rotation[:, :2, 0], motion)
    length = np.linalg.norm(motion, axis=-1, keepdims=True)
    return np.where(length > 1e-9, motion / np.maximum(length, 1e-9), np.nan)


def relative_errors(estimate: Trajectory, truth: Trajectory, length_m: float) -> RelativeErrors:
    """Compare the motions over every stretch of true way of at least `length_m` metres, one from each pose."""
    way = truth.distances
    end = np.searchsorted(way, way + length_m, side="left")
    start = np.flatnonzero(end < len(way))
    end = end[start]
    T_true = truth.T_map_body[start].inverse() @ truth.T_map_body[end]
    T_estimated = estimate.T_map_body[start].inverse() @ estimate.T_map_body[end]
    translation, rotation = T_true.distance(T_estimated)
    return RelativeErrors(way[end] - way[start], translation, rotation)


def nees(estimate: Trajectory, truth: Trajectory) -> Array:
    """Return the normalised estimation error squared (N,) of six degrees of freedom; its mean should be near 6.

    The error is xi of `T_true = T_estimated @ exp(xi)`. NaN where the covariance is not positive definite.
    """
    if estimate.covariances is None:
        return np.full(len(estimate), np.nan)
    xi = (estimate.T_map_body.inverse() @ truth.T_map_body).log()
    covariances = estimate.covariances
    finite = np.isfinite(covariances.reshape(-1, 36).sum(axis=-1))
    eigenvalues = np.linalg.eigvalsh(np.where(finite[:, None, None], covariances, -np.eye(6)))
    good = finite & (eigenvalues[:, 0] > 0)
    safe = np.where(good[:, None, None], covariances, np.eye(6))
    squared = np.sum(xi * np.linalg.solve(safe, xi[..., None])[..., 0], axis=-1)
    return np.where(good, squared, np.nan)
