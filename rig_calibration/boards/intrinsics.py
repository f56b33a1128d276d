"""One camera by itself: its focal length by trial, then lens and board poses together.

Where a board is, from the rays of its corners: a homography, also for rays beyond 90 degrees off the axis.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rig_calibration.boards.bundle import solve
from rig_calibration.boards.lens import camera_from_vector, first_lens, lens_of
from rig_calibration.boards.linearize import residuals
from rig_calibration.boards.observability import spread
from rig_calibration.boards.rejection import Adjusted, adjust, noise_px
from rig_calibration.boards.state import AdjustmentProblem, RigState, camera_problem, camera_state
from rig_calibration.boards.views import Observations
from rig_calibration.constants import FOCAL_LENGTHS, NUM_TRIALS
from rig_calibration.params import CalibrationParams
from sphere_nav.geometry import SE3, Camera, so3
from sphere_nav.geometry.arrays import Array


def board_pose(rays: Array, points: Array) -> SE3:
    """Return `T_camera_board` from unit rays (n, 3) and points (n, 3) of the board's plane z = 0, n >= 4.

    Every ray is parallel to H (X, Y, 1) with H = [r1 r2 t]; two of its cross products with the ray are used.
    """
    center = points[:, :2].mean(axis=0)
    scale = np.sqrt(np.mean(np.sum((points[:, :2] - center) ** 2, axis=-1)))
    plane = np.concatenate([(points[:, :2] - center) / scale, np.ones((len(points), 1))], axis=-1)
    across = _across(rays)  # (n, 2, 3)
    rows = (across[:, :, :, None] * plane[:, None, None, :]).reshape(-1, 9)
    H = np.linalg.svd(rows, full_matrices=len(rows) < 9)[2][-1].reshape(3, 3)
    H = H / (0.5 * (np.linalg.norm(H[:, 0]) + np.linalg.norm(H[:, 1])) + 1e-300)
    if np.sum(rays * (plane @ H.T)) < 0:
        H = -H
    R = so3.nearest_rotations(np.stack([H[:, 0], H[:, 1], np.cross(H[:, 0], H[:, 1])], axis=-1))
    return SE3.from_parts(R, scale * H[:, 2] - R[:, :2] @ center)


def other_pose(T_camera_board: SE3, points: Array) -> SE3:
    """Return the second pose that a small or distant board may be taken for: tilted the other way about its centre."""
    center_board = points.mean(axis=0)
    center = T_camera_board.apply(center_board[None])[0]
    sight, normal = center / np.linalg.norm(center), T_camera_board.rotation[:, 2]
    mirrored = 2.0 * (normal @ sight) * sight - normal
    axis = np.cross(normal, mirrored)
    sine = np.linalg.norm(axis)
    angle = np.arctan2(sine, normal @ mirrored)
    R = so3.exp(axis * (angle / max(sine, 1e-12))) @ T_camera_board.rotation
    return SE3.from_parts(R, center - R @ center_board)


def _across(rays: Array) -> Array:
    """Return two unit vectors (n, 2, 3) at right angles to each ray."""
    helper = np.eye(3)[np.argmin(np.abs(rays), axis=-1)]
    first = np.cross(rays, helper)
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return np.stack([first, np.cross(rays, first)], axis=1)


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
    params: CalibrationParams,
    start: Camera | None = None,
) -> SingleCamera:
    """Find lens and board poses from the views of one camera; ValueError where no start fits."""
    problem = camera_problem(model, size, params.num_distortion, seen)
    kept = np.ones(len(seen.pixels))
    starts = [lens_of(start)] if start is not None else _starts(model, size, seen)
    tried = [_try(problem, lens, kept, params) for lens in starts]
    good = [state for state in tried if state is not None]
    if not good:
        raise ValueError(f"expected views that a {model} camera explains, found none of {seen.num_views}")
    best = min(good, key=lambda state: noise_px(residuals(problem, state), kept))
    better = _flip_where_better(problem, adjust(problem, best, kept, params).solution.state)
    adjusted = adjust(problem, better, kept, params)
    state = adjusted.solution.state
    errors, is_kept = adjusted.solution.residuals, adjusted.kept > 0
    covariance = spread(problem, state, errors, adjusted.kept).lenses[0]
    rms_px = float(np.sqrt(np.sum(errors[is_kept] ** 2) / max(int(np.count_nonzero(is_kept)), 1)))
    return SingleCamera(
        problem.camera(state, 0), state.T_world_rig.inverse(), adjusted, state.lenses[0], covariance, rms_px
    )


def view_poses(camera: Camera, seen: Observations) -> SE3:
    """Return `T_camera_board` (V,) of every view of a known camera, by homography; NaN where it sees no rays."""
    rays = camera.unproject(seen.pixels)
    poses = []
    for first, last in zip(seen.starts[:-1], seen.starts[1:], strict=True):
        good = np.isfinite(rays[first:last, 0])
        if np.count_nonzero(good) < 4:
            poses.append(np.full((4, 4), np.nan))
        else:
            poses.append(board_pose(rays[first:last][good], seen.points[first:last][good]).matrix)
    return SE3(np.stack(poses))


def _starts(model: str, size: tuple[int, int], seen: Observations) -> list[Array]:
    """Return the most promising lenses without distortion, by how well the board of each view fits."""
    problem = camera_problem(model, size, 0, seen)
    found = []
    for ratio in FOCAL_LENGTHS[model]:
        focal, center = ratio * size[0], (0.5 * (size[0] - 1), 0.5 * (size[1] - 1))
        lens = first_lens(model, focal, center)
        poses = view_poses(camera_from_vector(model, size, lens, 0), seen)
        if not np.all(np.isfinite(poses.matrix)):
            continue
        errors = residuals(problem, camera_state(lens, poses))
        found.append((float(np.median(np.linalg.norm(np.nan_to_num(errors, nan=1e3), axis=-1))), lens))
    return [lens for _, lens in sorted(found, key=lambda pair: pair[0])[:NUM_TRIALS]]


def _try(problem: AdjustmentProblem, lens: Array, kept: Array, params: CalibrationParams) -> RigState | None:
    """Adjust focal length, centre and poses, then the whole lens, for a few steps; None where points fall behind."""
    camera = camera_from_vector(problem.models[0], problem.sizes[0], lens, params.num_distortion)
    poses = view_poses(camera, problem.seen)
    if not np.all(np.isfinite(poses.matrix)):
        return None
    state = camera_state(lens, poses)
    errors = residuals(problem, state)
    if not np.all(np.isfinite(errors)):
        return None
    only_focal = problem.is_free.copy()
    only_focal[2:12] = False
    simple = replace(problem, is_free=only_focal)
    state = solve(simple, state, kept, 2.0 * noise_px(errors, kept), max_iterations=10).state
    huber_px = 2.0 * noise_px(residuals(problem, state), kept)
    return solve(problem, state, kept, huber_px, max_iterations=15).state


def _flip_where_better(problem: AdjustmentProblem, state: RigState) -> RigState:
    """Give each view the other pose of its board where that one fits better after a few steps."""
    seen = problem.seen
    T_camera_board = state.T_world_rig.inverse()
    matrices = [
        other_pose(T_camera_board[view], seen.points[first:last]).matrix
        for view, (first, last) in enumerate(zip(seen.starts[:-1], seen.starts[1:], strict=True))
    ]
    other = replace(state, T_world_rig=SE3(np.stack(matrices)).inverse())
    is_seen = np.isfinite(residuals(problem, other)[:, 0])
    whole = np.bincount(seen.view, ~is_seen, minlength=seen.num_views) == 0
    weights = whole[seen.view].astype(np.float64)
    other = solve(problem.fixed(lenses=True), other, weights, max_iterations=10).state
    ones = np.ones_like(weights)
    before = seen.per_view_rms(residuals(problem, state), ones)
    after = seen.per_view_rms(np.nan_to_num(residuals(problem, other), nan=1e6), ones)
    is_better = whole & (after < 0.98 * before)
    matrices_world = np.where(is_better[:, None, None], other.T_world_rig.matrix, state.T_world_rig.matrix)
    return replace(state, T_world_rig=SE3(matrices_world))
