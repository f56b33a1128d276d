"""How far estimated poses are from true ones: absolute, relative, lateral and longitudinal errors, consistency."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from sphere_nav.geometry import so3
from sphere_nav.geometry.arrays import TINY, Array
from sphere_nav.geometry.se3 import SE3
from sphere_nav.geometry.trajectory import Trajectory

DIRECTION_BASELINE_M = 0.2  # the direction of motion is measured over this way, to both sides
ALIGNMENTS = ("none", "poses", "se3", "sim3")
RPE_TOLERANCE = 0.1  # of a stretch of way, by which a pair of poses may be longer or shorter (that of evo)
MEDIAN_LENGTHS = {2: 1.1774, 3: 1.538}  # median length of so many normal numbers of standard deviation 1: sqrt of chi^2
HUBER, TUKEY = 3.0, 6.0  # standard deviations: from where the length of three errors counts less, or not at all
NUM_ROUNDS = 100  # of weighing anew


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


def align_trajectories(estimate: Trajectory, truth: Trajectory, kind: str) -> tuple[SE3, float]:
    """Return `T_truth_estimate` and scale that bring the trajectories together best, by `kind`.

    They are paired pose by pose. Kind: 'none'; 'poses' (positions and rotations together, `_align_poses`); by positions
    alone (Umeyama 1991) 'se3' (rigid) or 'sim3' (rigid and scale), which need a path that is no straight line.
    """
    if kind not in ALIGNMENTS:
        raise ValueError(f"align: expected one of {', '.join(ALIGNMENTS)}, found {kind!r}")
    if kind == "none":
        return SE3.identity(), 1.0
    if kind == "poses":
        return _align_poses(estimate.T_map_body, truth.T_map_body), 1.0
    return _fit_positions(estimate.positions, truth.positions, has_scale=kind == "sim3")


def _fit_positions(source: Array, target: Array, *, has_scale: bool) -> tuple[SE3, float]:
    """Return the motion and scale that bring positions (N, 3) together best; ValueError for those on one line."""
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    products = (target - target_mean).T @ (source - source_mean) / len(source)
    sizes = np.linalg.svd(products, compute_uv=False)
    if len(source) < 3 or sizes[1] < 1e-9 * max(sizes[0], 1e-30):
        raise ValueError(f"align: expected at least 3 poses that are not on one line, found {len(source)} poses")
    R = so3.nearest_rotations(products)
    variance = np.mean(np.sum((source - source_mean) ** 2, axis=-1))
    scale = float(np.sum(R * products) / variance) if has_scale else 1.0
    return SE3.from_parts(R, target_mean - scale * R @ source_mean), scale


def _align_poses(estimate: SE3, truth: SE3) -> SE3:
    """Return `T_truth_estimate` of paired poses (N,), by positions and rotations together.

    It minimises sum rho(|q - (R p + t)| / sigma_p) + rho(|log(R_q (R R_p)^T)| / sigma_r) with Tukey's rho. Both sigmas
    are those of the remaining errors, by their medians, found anew in each round: so a path that is straight, or short
    for its errors, is turned by its rotations, a long bent one by its positions, and a few wrong poses by none. Begun
    at what the rotations say and at what the positions say, it takes the end where sigma_p sigma_r is smaller.
    """
    R = so3.nearest_rotations(np.sum(truth.rotation @ np.swapaxes(estimate.rotation, -1, -2), axis=0))
    starts = [SE3.from_parts(R, np.median(truth.translation - estimate.translation @ R.T, axis=0))]
    with suppress(ValueError):
        starts.append(_fit_positions(estimate.translation, truth.translation, has_scale=False)[0])
    fits = [_refine(estimate, truth, start) for start in starts]
    return min(fits, key=lambda fit: fit[0])[1]


def _refine(estimate: SE3, truth: SE3, start: SE3) -> tuple[float, SE3]:
    """Return log(sigma_p sigma_r) and the pose where weighing anew has settled, from a start on."""
    R, t = start.rotation, start.translation
    for number in range(NUM_ROUNDS):
        rotated = estimate.translation @ R.T
        off = truth.translation - rotated - t
        turn = so3.log(truth.rotation @ np.swapaxes(R @ estimate.rotation, -1, -2))
        is_near = number >= NUM_ROUNDS // 4
        (w, sigma_p), (v, sigma_r) = _weigh(off, is_near=is_near), _weigh(turn, is_near=is_near)
        center, mean = np.average(rotated, axis=0, weights=w), np.average(off, axis=0, weights=w)
        arms = rotated - center
        # off - mean ~ delta x arm, turn ~ delta: the normal equations of delta
        A = np.sum(arms**2, axis=-1)[:, None, None] * np.eye(3) - arms[:, :, None] * arms[:, None, :]
        b = np.sum(w[:, None] * np.cross(arms, off - mean), axis=0) + np.sum(v[:, None] * turn, axis=0)
        delta = np.linalg.solve(np.einsum("n,nij->ij", w, A) + v.sum() * np.eye(3), b)
        R_step = so3.exp(delta)
        R, t = R_step @ R, t + mean + center - R_step @ center
        if is_near and max(np.abs(delta).max(), np.abs(mean).max()) < TINY:
            break
    return float(np.log(sigma_p) + np.log(sigma_r)), SE3.from_parts(R, t)


def _weigh(errors: Array, *, is_near: bool) -> tuple[Array, float]:
    """Return what errors (N, 3) weigh, over their variance, and their standard deviation, which they tell themselves.

    Far from the end by Huber's rho, which nothing is lost to; near it by Tukey's, which is blind to what is wrong.
    """
    size = np.linalg.norm(errors, axis=-1)
    sigma = max(float(np.median(size)) / MEDIAN_LENGTHS[3], TINY)
    huber = np.minimum(1.0, HUBER * sigma / np.maximum(size, TINY))
    tukey = np.clip(1.0 - (size / (TUKEY * sigma)) ** 2, 0.0, None) ** 2
    return (tukey if is_near else huber) / sigma**2, sigma


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
    """Compare the motions over stretches of true way, one from each pose to that which is nearest to `length_m` away.

    As evo does (`evo_rpe --all_pairs --pairs_from_reference -u m`): within `RPE_TOLERANCE` of the length.
    """
    way, numbers = truth.distances, np.arange(len(truth))
    after = np.minimum(np.searchsorted(way, way + length_m, side="left"), len(way) - 1)
    before = np.maximum(np.searchsorted(way, way[np.maximum(after - 1, 0)], side="left"), numbers + 1)
    before = np.minimum(before, after)
    is_before = np.abs(way[before] - way - length_m) <= np.abs(way[after] - way - length_m)
    end = np.where(is_before, before, after)
    is_paired = (end > numbers) & (np.abs(way[end] - way - length_m) <= RPE_TOLERANCE * length_m)
    start, end = numbers[is_paired], end[is_paired]
    T_true = truth.T_map_body[start].inverse() @ truth.T_map_body[end]
    T_estimated = estimate.T_map_body[start].inverse() @ estimate.T_map_body[end]
    translation, rotation = T_true.distance(T_estimated)
    return RelativeErrors(way[end] - way[start], translation, rotation)


def nees(estimate: Trajectory, truth: Trajectory) -> Array:
    """Return the normalised estimation error squared (N,) of six degrees of freedom; its mean should be near 6.

    The error is xi of `T_true = T_estimated @ exp(xi)`. NaN where the covariance is not positive definite.
    """
    xi = (estimate.T_map_body.inverse() @ truth.T_map_body).log()
    given = np.full((len(estimate), 6, 6), np.nan) if estimate.covariances is None else estimate.covariances
    is_finite = np.isfinite(given.reshape(-1, 36).sum(axis=-1))
    eigenvalues = np.linalg.eigvalsh(np.where(is_finite[:, None, None], given, -np.eye(6)))
    is_good = is_finite & (eigenvalues[:, 0] > 0)
    covariances = np.where(is_good[:, None, None], given, np.eye(6))
    squared = np.sum(xi * np.linalg.solve(covariances, xi[..., None])[..., 0], axis=-1)
    return np.where(is_good, squared, np.nan)
