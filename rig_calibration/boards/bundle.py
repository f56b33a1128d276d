"""Bundle adjustment: Levenberg-Marquardt over lenses, cameras, boards and rig poses.

A corner P of board b, seen by camera c at instant i, lies at p = X_c^-1 R_i^-1 B_b P in the camera, with
X = T_rig_camera, R = T_world_rig, B = T_world_board. With X exp(xi), R exp(xi) and B exp(xi):
dp/d xi_X = [-I, [p]x],  dp/d xi_R = R_X^T [-I, [X p]x],  dp/d xi_B = R_cb [I, -[P]x].
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import huber

from rig_calibration.boards.state import SHARED, AdjustmentProblem, RigState
from rig_calibration.constants import FIRST_DAMPING, MAX_DAMPING, MIN_GAIN
from sphere_nav.estimation.robust import huber_weights
from sphere_nav.geometry import SE3, so3
from sphere_nav.geometry.arrays import TINY, Array
from sphere_nav.geometry.cameras.lens import NUM_LENS, J_lens


@dataclass(frozen=True, eq=False)
class Solution:
    """The best state found, and its residuals (N, 2) in pixels."""

    state: RigState
    residuals: Array


def solve(
    problem: AdjustmentProblem, start: RigState, weights: Array, huber_px: float = np.inf, max_iterations: int = 60
) -> Solution:
    """Minimise the weighted squares, linear beyond `huber_px`. Corners (N,) of weight 0 do not count."""
    state, damping, errors = start, FIRST_DAMPING, residuals(problem, start)
    cost = _cost(errors, weights, huber_px)
    if not np.isfinite(cost):
        raise ValueError("bundle adjustment: expected a start with all boards in front of their cameras")
    for _ in range(max_iterations):
        known, before = np.nan_to_num(errors), cost
        robust = weights * huber_weights(np.linalg.norm(known, axis=-1), huber_px)
        H, gradient = normal_equations(problem, state, known, robust)
        while damping < MAX_DAMPING:
            trial = state.moved(_step(H, gradient, damping))
            trial_errors = residuals(problem, trial)
            trial_cost = _cost(trial_errors, weights, huber_px)
            if trial_cost <= cost:
                state, errors, cost, damping = trial, trial_errors, trial_cost, max(damping / 8.0, TINY)
                break
            damping *= 8.0
        if before - cost <= MIN_GAIN * before + TINY * TINY:
            break
    return Solution(state, errors)


def rms_px(errors: Array, kept: Array) -> float:
    """Return the RMS of the residuals (N, 2) that count; NaN where none does."""
    squares = np.sum(errors[kept > 0] ** 2, axis=-1)
    return float(np.sqrt(squares.mean())) if squares.size else float("nan")


def information(problem: AdjustmentProblem, state: RigState, weights: Array) -> Array:
    """Return the information (S, S) about lenses, cameras and boards, in units of one pixel; zeros for held ones."""
    H, _ = normal_equations(problem, state, np.nan_to_num(residuals(problem, state)), weights)
    shared = problem.num_shared
    poses = H[shared:, shared:] + np.diag(np.where(np.diag(H)[shared:] > 0, TINY, 1.0))
    return H[:shared, :shared] - H[:shared, shared:] @ np.linalg.solve(poses, H[shared:, :shared])


def residuals(problem: AdjustmentProblem, state: RigState) -> Array:
    """Return projected minus seen pixels (N, 2); NaN where a point is behind a camera, or a lens is none."""
    seen, (points, _) = problem.seen, _points_camera(problem, state)
    found = np.full_like(seen.pixels, np.nan)
    for camera, rows in seen.camera_slices:
        with suppress(ValueError):
            found[rows] = problem.camera(state, camera).project(points[rows])[0]
    return found - seen.pixels


def jacobian(problem: AdjustmentProblem, state: RigState) -> tuple[Array, NDArray[np.intp]]:
    """Return the derivatives (N, 2, 30) of the residuals by lens, camera, board and rig pose of each view.

    Zero for what is held; with the places (V, 30) of these in a step (18 C + 6 B + 6 I,) of the state.
    """
    seen, (points, R_camera_board) = problem.seen, _points_camera(problem, state)
    J = np.empty((len(points), 2, SHARED + 12))
    for camera, rows in seen.camera_slices:
        lens, X = problem.camera(state, camera), state.T_rig_camera[camera]
        J_point = lens.J_project(points[rows])
        J[rows, :, :NUM_LENS] = J_lens(lens, points[rows])
        J[rows, :, NUM_LENS:SHARED] = J_point @ J_moved_frame(points[rows])
        J[rows, :, SHARED:-6] = J_point @ R_camera_board[rows] @ -J_moved_frame(seen.points[rows])
        J[rows, :, -6:] = J_point @ X.rotation.T @ J_moved_frame(X.apply(points[rows]))
    boards, poses = SHARED * len(problem.models) + 6 * seen.board, problem.num_shared + 6 * seen.instant
    blocks = zip((SHARED * seen.camera, boards, poses), (SHARED, 6, 6), strict=True)
    columns = np.concatenate([first[:, None] + np.arange(size) for first, size in blocks], axis=1)
    free = np.append(problem.is_free, np.ones(6 * len(state.T_world_rig.matrix), bool))
    return np.nan_to_num(J) * free[columns][seen.view][:, None], columns


def J_moved_frame(points: Array) -> Array:
    """Return d (exp(-xi) p) / d xi (N, 3, 6) at xi = 0, of points (N, 3) in a frame that moves by exp(xi)."""
    return np.concatenate([np.broadcast_to(-np.eye(3), (len(points), 3, 3)), so3.hat(points)], axis=2)


def normal_equations(problem: AdjustmentProblem, state: RigState, errors: Array, weights: Array) -> tuple[Array, Array]:
    """Return the weighted J^T J and J^T e of errors (N, 2)."""
    seen, (J, columns) = problem.seen, jacobian(problem, state)
    size = problem.num_shared + 6 * len(state.T_world_rig.matrix)
    H, gradient = np.zeros((size, size)), np.zeros(size)
    for rows, own in zip(seen.rows, columns, strict=True):
        flat = J[rows].reshape(-1, J.shape[-1])
        weighted = flat.T * np.repeat(weights[rows], 2)
        H[np.ix_(own, own)] += weighted @ flat
        gradient[own] += weighted @ errors[rows].ravel()
    return H, gradient


def _points_camera(problem: AdjustmentProblem, state: RigState) -> tuple[Array, Array]:
    """Return the corners (N, 3) in the frames of their cameras, and the rotations (N, 3, 3) from their boards."""
    seen = problem.seen
    T_camera_world = (state.T_world_rig[seen.instant] @ state.T_rig_camera[seen.camera]).inverse()
    T: SE3 = (T_camera_world @ state.T_world_board[seen.board])[seen.view]
    return np.einsum("nij,nj->ni", T.rotation, seen.points) + T.translation, T.rotation


def _cost(errors: Array, weights: Array, huber_px: float) -> float:
    size = np.linalg.norm(errors[weights > 0], axis=-1)
    if not np.all(np.isfinite(size)):
        return float("inf")
    return float(2.0 * weights[weights > 0] @ huber(huber_px, size))


def _step(H: Array, gradient: Array, damping: float) -> Array:
    """Return the damped step; zeros where nothing is told."""
    told = np.flatnonzero(np.diag(H) > 0)
    scale = 1.0 / np.sqrt(np.diag(H)[told])
    scaled = H[np.ix_(told, told)] * scale * scale[:, None] + (damping + TINY) * np.eye(len(told))
    step = np.zeros(len(gradient))
    step[told] = -scale * np.linalg.solve(scaled, scale * gradient[told])
    return step
