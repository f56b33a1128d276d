"""Where a board is, from the rays of its corners: a homography, also for rays beyond 90 degrees off the axis."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sphere_geometry import SE3, so3

Array = NDArray[np.float64]


def board_pose(rays: Array, points: Array) -> SE3:
    """Return `T_camera_board` from unit rays (n, 3) and points (n, 3) of the board's plane z = 0, n >= 4.

    Every ray is parallel to H (X, Y, 1) with H = [r1 r2 t]; two of its cross products with the ray are used.
    """
    centre = points[:, :2].mean(axis=0)
    scale = np.sqrt(np.mean(np.sum((points[:, :2] - centre) ** 2, axis=-1)))
    plane = np.concatenate([(points[:, :2] - centre) / scale, np.ones((len(points), 1))], axis=-1)
    across = _across(rays)  # (n, 2, 3)
    rows = (across[:, :, :, None] * plane[:, None, None, :]).reshape(-1, 9)
    H = np.linalg.svd(rows, full_matrices=len(rows) < 9)[2][-1].reshape(3, 3)
    H = H / (0.5 * (np.linalg.norm(H[:, 0]) + np.linalg.norm(H[:, 1])) + 1e-300)
    if np.sum(rays * (plane @ H.T)) < 0:
        H = -H
    U, _, Vt = np.linalg.svd(np.stack([H[:, 0], H[:, 1], np.cross(H[:, 0], H[:, 1])], axis=-1))
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return SE3.from_parts(R, scale * H[:, 2] - R[:, :2] @ centre)


def other_pose(T_camera_board: SE3, points: Array) -> SE3:
    """Return the second pose that a small or distant board may be taken for: tilted the other way about its centre."""
    centre_board = points.mean(axis=0)
    centre = T_camera_board.apply(centre_board[None])[0]
    sight, normal = centre / np.linalg.norm(centre), T_camera_board.rotation[:, 2]
    mirrored = 2.0 * (normal @ sight) * sight - normal
    axis = np.cross(normal, mirrored)
    sine = np.linalg.norm(axis)
    angle = np.arctan2(sine, normal @ mirrored)
    R = so3.exp(axis * (angle / max(sine, 1e-12))) @ T_camera_board.rotation
    return SE3.from_parts(R, centre - R @ centre_board)


def _across(rays: Array) -> Array:
    """Return two unit vectors (n, 2, 3) at right angles to each ray."""
    helper = np.eye(3)[np.argmin(np.abs(rays), axis=-1)]
    first = np.cross(rays, helper)
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return np.stack([first, np.cross(rays, first)], axis=1)
