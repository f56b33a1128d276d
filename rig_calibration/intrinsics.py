"""One camera by itself: its focal length by trial, then lens and board poses together."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rig_calibration.board_pose import board_pose, other_pose
from rig_calibration.bundle import solve
from rig_calibration.lens import camera_of, lens_of
from rig_calibration.linearize import residuals
from rig_calibration.observability import spread
from rig_calibration.params import CalibrationParams
from rig_calibration.rejection import Adjusted, adjust, noise_px
from rig_calibration.state import Problem, State, camera_problem, camera_state
from rig_calibration.views import Observations
from sphere_geometry import SE3, Camera

Array = NDArray[np.float64]

FOCAL_LENGTHS = {"pinhole": np.geomspace(0.25, 4.0, 15), "fisheye": np.geomspace(0.12, 1.2, 13)}  # by the image's width
NUM_TRIALS = 3


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
        focal, centre = ratio * size[0], (0.5 * (size[0] - 1), 0.5 * (size[1] - 1))
        lens = np.array([focal, focal, *centre, *np.zeros(8)])
        poses = view_poses(camera_of(model, size, lens, 0), seen)
        if not np.all(np.isfinite(poses.matrix)):
            continue
        errors = residuals(problem, camera_state(lens, poses))
        found.append((float(np.median(np.linalg.norm(np.nan_to_num(errors, nan=1e3), axis=-1))), lens))
    return [lens for _, lens in sorted(found, key=lambda pair: pair[0])[:NUM_TRIALS]]


def _try(problem: Problem, lens: Array, kept: Array, params: CalibrationParams) -> State | None:
    """Adjust focal length, centre and poses, then the whole lens, for a few steps; None where points fall behind."""
    camera = camera_of(problem.models[0], problem.sizes[0], lens, params.num_distortion)
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


def _flip_where_better(problem: Problem, state: State) -> State:
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
