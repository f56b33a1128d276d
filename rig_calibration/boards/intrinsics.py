"""One camera by itself: its focal length by trial, then lens and board poses together."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from rig_calibration.boards.bundle import residuals, rms_px, solve
from rig_calibration.boards.observability import spread
from rig_calibration.boards.rejection import Adjusted, adjust, noise_px, view_medians
from rig_calibration.boards.state import AdjustmentProblem, RigState, camera_state, rig_problem
from rig_calibration.boards.views import Observations
from rig_calibration.constants import (
    FOCAL_LENGTHS,
    MIN_AHEAD,
    MIN_CORNERS,
    NUM_DISTORTION,
    NUM_TRIALS,
)
from sphere_nav.geometry import SE3, Camera, so3
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.lens import NUM_LENS, camera_of, first_lens, lens_of


def board_poses(rays: Array, points: Array) -> tuple[SE3, SE3]:
    """Return both `T_camera_board` that rays (n, 3) and points (n, 3) of a plane allow, the better one first.

    By IPPE (Collins, Bartoli 2014) in the tangent plane of the middle ray; a small or distant board is seen alike when
    it is tilted the other way. NaN for fewer than four rays.
    """
    rays, points = rays[known := np.isfinite(rays[:, 0])], points[known]
    if len(rays) < MIN_CORNERS:
        return SE3(np.full((4, 4), np.nan)), SE3(np.full((4, 4), np.nan))
    middle = rays.mean(axis=0) / np.linalg.norm(rays.mean(axis=0))
    x = np.cross(np.eye(3)[np.argmin(np.abs(middle))], middle)
    x /= np.linalg.norm(x)
    R = np.stack([x, np.cross(middle, x), middle])
    ahead = rays @ R.T
    near = ahead[:, 2] > MIN_AHEAD
    flat = ahead[near, :2] / ahead[near, 2:]
    _, turns, moves, _ = cv2.solvePnPGeneric(points[near], flat, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
    found = [
        SE3.from_parts(R.T @ so3.exp(turn.ravel()), R.T @ move.ravel()) for turn, move in zip(turns, moves, strict=True)
    ]
    return found[0], found[-1]


@dataclass(frozen=True, eq=False)
class SingleCamera:
    """One camera calibrated by itself: `T_camera_board` (V,) of all its views, and which corners (N,) fit.

    lens (12,) with its covariance (12, 12) and the RMS residual: what the images of this camera alone say.
    """

    camera: Camera
    T_camera_board: SE3
    adjusted: Adjusted
    lens: Array
    lens_covariance: Array
    rms_px: float

    @property
    def num_views(self) -> int:
        """Views of the board."""
        return len(self.T_camera_board.matrix)


def calibrate_camera(
    model: str,
    size: tuple[int, int],
    seen: Observations,
    start: Camera | None = None,
) -> SingleCamera:
    """Find lens and board poses from the views of one camera; ValueError where no start fits."""
    problem = rig_problem((model,), (size,), seen)
    kept = np.ones(len(seen.pixels))
    starts = [lens_of(start)] if start is not None else _starts(model, size, seen)
    tried = [_try(problem, lens, kept) for lens in starts]
    good = [state for state in tried if state is not None]
    if not good:
        raise ValueError(f"expected views that a {model} camera explains, found none of {seen.num_views}")
    best = min(good, key=lambda state: noise_px(residuals(problem, state), kept))
    better = _flip_where_better(problem, adjust(problem, best, kept).solution.state)
    adjusted = adjust(problem, better, kept)
    state = adjusted.solution.state
    judged = adjusted.solution.residuals, adjusted.kept
    covariance = spread(problem, state, *judged).lenses[0]
    return SingleCamera(
        problem.camera(state, 0), state.T_world_rig.inverse(), adjusted, state.lenses[0], covariance, rms_px(*judged)
    )


def view_poses(camera: Camera, seen: Observations) -> tuple[SE3, SE3]:
    """Return both possible `T_camera_board` (V,) of every view of a known camera, better ones first; NaN without."""
    rays = camera.unproject(seen.pixels)
    ends = zip(seen.starts[:-1], seen.starts[1:], strict=True)
    better, other = zip(*(board_poses(rays[a:b], seen.points[a:b]) for a, b in ends), strict=True)
    return SE3(np.stack([T.matrix for T in better])), SE3(np.stack([T.matrix for T in other]))


def _starts(model: str, size: tuple[int, int], seen: Observations) -> list[Array]:
    """Return the most promising lenses without distortion, by how well the board of each view fits."""
    problem = rig_problem((model,), (size,), seen)
    found = []
    for ratio in FOCAL_LENGTHS[model]:
        focal, center = ratio * size[0], (0.5 * (size[0] - 1), 0.5 * (size[1] - 1))
        lens = first_lens(model, focal, center)
        poses, _ = view_poses(camera_of(model, size, lens, NUM_DISTORTION), seen)
        if not np.all(np.isfinite(poses.matrix)):
            continue
        errors = residuals(problem, camera_state(lens, poses))
        found.append((float(np.median(np.linalg.norm(np.nan_to_num(errors, nan=1e3), axis=-1))), lens))
    return [lens for _, lens in sorted(found, key=lambda pair: pair[0])[:NUM_TRIALS]]


def _try(problem: AdjustmentProblem, lens: Array, kept: Array) -> RigState | None:
    """Adjust focal length, centre and poses, then the whole lens, for a few steps; None where points fall behind."""
    camera = camera_of(problem.models[0], problem.sizes[0], lens, NUM_DISTORTION)
    state = camera_state(lens, view_poses(camera, problem.seen)[0])
    errors = residuals(problem, state)
    if not np.all(np.isfinite(errors)):
        return None
    simple = problem.held(slice(2, NUM_LENS))
    state = solve(simple, state, kept, 2.0 * noise_px(errors, kept), max_iterations=10).state
    huber_px = 2.0 * noise_px(residuals(problem, state), kept)
    return solve(problem, state, kept, huber_px, max_iterations=15).state


def _flip_where_better(problem: AdjustmentProblem, state: RigState) -> RigState:
    """Give each view the other pose of its board where that one fits better after a few steps."""
    seen, now = problem.seen, state.T_world_rig
    both = [T.inverse() for T in view_poses(problem.camera(state, 0), seen)]
    is_same = both[0].distance(now)[1] < both[1].distance(now)[1]
    far = np.where(is_same[:, None, None], both[1].matrix, both[0].matrix)
    other = replace(state, T_world_rig=SE3(far))
    is_seen = np.isfinite(residuals(problem, other)[:, 0])
    whole = np.bincount(seen.view, ~is_seen, minlength=seen.num_views) == 0
    weights = whole[seen.view].astype(np.float64)
    other = replace(other, T_world_rig=SE3(np.where(whole[:, None, None], far, now.matrix)))
    other = solve(problem.held(), other, weights, max_iterations=10).state
    before, after = (
        view_medians(
            seen, np.linalg.norm(np.nan_to_num(residuals(problem, one), nan=1e6), axis=-1), np.ones_like(weights)
        )
        for one in (state, other)
    )
    is_better = whole & (after < 0.98 * before)
    return replace(state, T_world_rig=SE3(np.where(is_better[:, None, None], other.T_world_rig.matrix, now.matrix)))
