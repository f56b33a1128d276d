"""Residuals of a state and their derivatives, as the normal equations of the adjustment.

A corner P of board b, seen by camera c at instant i, lies at p = X_c^-1 R_i^-1 B_b P in the camera, with
X = T_rig_camera, R = T_world_rig, B = T_world_board. With X exp(xi), R exp(xi) and B exp(xi):
dp/d xi_X = [-I, [p]x],  dp/d xi_R = R_X^T [-I, [X p]x],  dp/d xi_B = R_cb [I, -[P]x].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig_calibration.boards.lens import NUM_LENS, J_lens, camera_from_vector, project_points
from rig_calibration.boards.state import SHARED, AdjustmentProblem, RigState
from sphere_nav.geometry import SE3, so3
from sphere_nav.geometry.arrays import Array

NUM_COLUMNS = SHARED + 6 + 6  # of one view: lens, camera, board, rig pose
POSE = slice(SHARED + 6, NUM_COLUMNS)


@dataclass(frozen=True, eq=False)
class Normal:
    """Normal equations: `shared` (S, S) and `poses` (I, 6, 6) on the diagonal, `mixed` (S, I, 6) beside it."""

    shared: Array
    mixed: Array
    poses: Array
    gradient: Array
    pose_gradients: Array


def residuals(problem: AdjustmentProblem, state: RigState) -> Array:
    """Return projected minus seen pixels (N, 2); NaN where a point is behind a pinhole."""
    seen, points = problem.seen, _points_camera(problem, state)
    found = np.empty_like(seen.pixels)
    for camera, rows in seen.camera_slices:
        found[rows] = project_points(problem.models[camera], state.lenses[camera], points[rows])
    return found - seen.pixels


def jacobian(problem: AdjustmentProblem, state: RigState) -> Array:
    """Return the derivatives (N, 2, 30) of the residuals by lens, camera, board and rig pose of their view."""
    seen, points = problem.seen, _points_camera(problem, state)
    T_camera_board = _T_camera_board(problem, state)[seen.view]
    J = np.empty((len(points), 2, NUM_COLUMNS))
    for camera, rows in seen.camera_slices:
        lens, model, X = state.lenses[camera], problem.models[camera], state.T_rig_camera[camera]
        J[rows, :, :NUM_LENS] = J_lens(model, lens, points[rows])
        J_point = camera_from_vector(model, problem.sizes[camera], lens, 8).J_project(points[rows])
        J[rows, :, NUM_LENS:SHARED] = J_point @ J_moved_frame(points[rows])
        J[rows, :, POSE] = J_point @ X.rotation.T @ J_moved_frame(X.apply(points[rows]))
        J_board = T_camera_board[rows].rotation @ -J_moved_frame(seen.points[rows])
        J[rows, :, SHARED : SHARED + 6] = J_point @ J_board
    return J


def J_moved_frame(points: Array) -> Array:
    """Return d (exp(-xi) p) / d xi (N, 3, 6) at xi = 0, of points (N, 3) in a frame that moves by exp(xi)."""
    J = np.empty((len(points), 3, 6))
    J[:, :, :3] = -np.eye(3)
    J[:, :, 3:] = so3.hat(points)
    return J


def normal_equations(problem: AdjustmentProblem, state: RigState, errors: Array, weights: Array) -> Normal:
    """Sum weighted products of the Jacobian of every view; held parameters get zeros."""
    seen, J = problem.seen, jacobian(problem, state)
    num_shared, num_poses = len(problem.is_free), len(state.T_world_rig.matrix)
    normal = Normal(
        np.zeros((num_shared, num_shared)),
        np.zeros((num_shared, num_poses, 6)),
        np.zeros((num_poses, 6, 6)),
        np.zeros(num_shared),
        np.zeros((num_poses, 6)),
    )
    views = np.flatnonzero(np.bincount(seen.view, weights, minlength=seen.num_views) > 0)
    H, gradient = np.empty((len(views), NUM_COLUMNS, NUM_COLUMNS)), np.empty((len(views), NUM_COLUMNS))
    for index, view in enumerate(views):
        rows = slice(seen.starts[view], seen.starts[view + 1])
        own = J[rows].reshape(-1, NUM_COLUMNS)
        weighted = own.T * np.repeat(weights[rows], 2)
        H[index], gradient[index] = weighted @ own, weighted @ errors[rows].ravel()
    _add_views(normal, problem, views, H, gradient)
    held = ~problem.is_free
    normal.shared[held], normal.mixed[held], normal.gradient[held] = 0.0, 0.0, 0.0
    normal.shared[:, held] = 0.0
    return normal


def _add_views(normal: Normal, problem: AdjustmentProblem, views: NDArray[np.intp], H: Array, gradient: Array) -> None:
    """Add the products (V, 30, 30) and (V, 30) of views to the rows and columns of what they depend on."""
    seen = problem.seen
    camera = SHARED * seen.camera[views][:, None] + np.arange(SHARED)
    board = SHARED * len(problem.models) + 6 * seen.board[views][:, None] + np.arange(6)
    columns = np.concatenate([camera, board], axis=1)
    pose, inner = seen.instant[views], columns.shape[1]
    np.add.at(normal.shared, (columns[:, :, None], columns[:, None, :]), H[:, :inner, :inner])
    np.add.at(normal.mixed, (columns, pose[:, None]), H[:, :inner, POSE])
    np.add.at(normal.poses, pose, H[:, POSE, POSE])
    np.add.at(normal.gradient, columns, gradient[:, :inner])
    np.add.at(normal.pose_gradients, pose, gradient[:, POSE])


def _T_camera_board(problem: AdjustmentProblem, state: RigState) -> SE3:
    seen = problem.seen
    T_camera_world = (state.T_world_rig[seen.instant] @ state.T_rig_camera[seen.camera]).inverse()
    return T_camera_world @ state.T_world_board[seen.board]


def _points_camera(problem: AdjustmentProblem, state: RigState) -> Array:
    T = _T_camera_board(problem, state)[problem.seen.view]
    points: Array = np.einsum("nij,nj->ni", T.rotation, problem.seen.points) + T.translation
    return points
