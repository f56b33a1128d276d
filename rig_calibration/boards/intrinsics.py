"""One camera by itself: its focal length by trial, then lens and board poses together."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from rig_calibration.boards.bundle import camera_state, residuals, rig_problem
from rig_calibration.boards.observability import spread
from rig_calibration.boards.rejection import Adjusted, adjust
from rig_calibration.boards.views import Observations
from rig_calibration.constants import (
    FOCAL_LENGTHS,
    MIN_AHEAD,
    MIN_CORNERS,
    NUM_DISTORTION,
)
from sphere_nav.geometry import SE3, Camera, so3
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.lens import camera_of, first_lens, lens_of


def board_pose(rays: Array, points: Array) -> SE3:
    """Return the `T_camera_board` that rays (n, 3) and points (n, 3) of a plane allow; NaN for fewer than four rays.

    By IPPE (Collins, Bartoli 2014) in the tangent plane of the middle ray; of both tilts that fit, the better one.
    """
    rays, points = rays[known := np.isfinite(rays[:, 0])], points[known]
    if len(rays) < MIN_CORNERS:
        return SE3(np.full((4, 4), np.nan))
    middle = rays.mean(axis=0) / np.linalg.norm(rays.mean(axis=0))
    x = np.cross(np.eye(3)[np.argmin(np.abs(middle))], middle)
    x /= np.linalg.norm(x)
    R = np.stack([x, np.cross(middle, x), middle])
    ahead = rays @ R.T
    near = ahead[:, 2] > MIN_AHEAD
    flat = ahead[near, :2] / ahead[near, 2:]
    _, turn, move = cv2.solvePnP(points[near], flat, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
    return SE3.from_parts(R.T @ so3.exp(turn.ravel()), R.T @ move.ravel())


@dataclass(frozen=True, eq=False)
class SingleCamera:
    """One camera calibrated by itself, with the covariance (12, 12) of its lens: what its images alone say."""

    camera: Camera
    adjusted: Adjusted
    lens_covariance: Array


def calibrate_camera(
    model: str,
    size: tuple[int, int],
    seen: Observations,
    start: Camera | None = None,
) -> SingleCamera:
    """Find lens and board poses from the views of one camera; ValueError where no start fits."""
    problem = rig_problem((model,), (size,), seen)
    center = (0.5 * (size[0] - 1), 0.5 * (size[1] - 1))
    lenses = [lens_of(start)] if start is not None else []
    lenses = lenses or [first_lens(model, ratio * size[0], center) for ratio in FOCAL_LENGTHS[model]]
    states = [camera_state(lens, view_poses(camera_of(model, size, lens, NUM_DISTORTION), seen)) for lens in lenses]
    costs = [_misfit(residuals(problem, state)) for state in states]
    if not np.isfinite(min(costs)):
        raise ValueError(f"expected views that a {model} camera explains, found none of {seen.num_views}")
    adjusted = adjust(problem, states[int(np.argmin(costs))], np.ones(len(seen.pixels)))
    covariance = spread(problem, adjusted.state, adjusted.residuals, adjusted.kept).lenses[0]
    return SingleCamera(problem.camera(adjusted.state, 0), adjusted, covariance)


def view_poses(camera: Camera, seen: Observations) -> SE3:
    """Return `T_camera_board` (V,) of every view of a known camera; NaN without."""
    rays = camera.unproject(seen.pixels)
    return SE3(np.stack([board_pose(rays[rows], seen.points[rows]).matrix for rows in seen.rows]))


def _misfit(errors: Array) -> float:
    """Return how far a corner is off in the middle, px; infinite where one is behind the camera."""
    size = np.linalg.norm(errors, axis=-1)
    return float(np.median(size)) if np.all(np.isfinite(size)) else np.inf
