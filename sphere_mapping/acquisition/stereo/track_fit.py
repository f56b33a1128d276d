"""What is off in a pair's disparity, from a drive, without truth: a point's range must agree with itself.

Corners are followed through a few instants in both images. Motions of the left camera, inverse depths of the corners
and the numbers of the disparity that explain all pixels best are found by robust least squares (a small bundle
adjustment; the depths are eliminated, Triggs et al. 2000 section 6.1): the whole polynomial where chance would hardly
give more than offset and bow, else these two. The scale of the world is the baseline's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sphere_mapping.acquisition.constants import (
    CORRELATED_CORNERS,
    TRACK_FLOOR_PX,
    TRACK_LOSS_PX,
    TRACK_PRIOR_PX,
    TRACK_STEPS,
)
from sphere_mapping.acquisition.stereo.stereo_field import (
    NUM_BOW,
    NUM_COLUMNS,
    basis_of_columns,
    slopes_of_columns,
    tangents,
)
from sphere_nav.estimation.gates import gate, squared_mahalanobis
from sphere_nav.estimation.robust import cauchy_weights
from sphere_nav.geometry import SE3, Pinhole, so3
from sphere_nav.geometry.arrays import Array


@dataclass(frozen=True, eq=False)
class Window:
    """Corners (N) seen in K consecutive instants: left (K, N, 2) and right columns (K, N); rows of both agree.

    NaN in instants after which a corner was lost.
    """

    left: Array
    right_u: Array


@dataclass(frozen=True, eq=False)
class ColumnFit:
    """Numbers (2,) or (8,) of the disparity in px, as measured, their covariance, and the number of corners."""

    columns: Array
    covariance: Array
    num_tracks: int

    @property
    def is_significant(self) -> bool:
        """Whether chance would hardly give this."""
        return self._is_more_than(0)

    @property
    def is_more_than_bow(self) -> bool:
        """Whether chance would hardly give what there is beside offset and bow."""
        return len(self.columns) > NUM_BOW and self._is_more_than(NUM_BOW)

    def _is_more_than(self, first: int) -> bool:
        rest, covariance = self.columns[first:], self.covariance[first:, first:]
        return squared_mahalanobis(rest, covariance) > gate(len(rest), 5e-4)


def fit_columns(camera: Pinhole, baseline_m: float, windows: Sequence[Window]) -> ColumnFit | None:
    """Return what is off in the disparity, None without windows."""
    if not windows:
        return None
    whole = _fit(camera, baseline_m, windows, NUM_COLUMNS)
    return whole if whole.is_more_than_bow else _fit(camera, baseline_m, windows, NUM_BOW)


def _fit(camera: Pinhole, baseline_m: float, windows: Sequence[Window], number: int) -> ColumnFit:
    """Return the first numbers of the polynomial, so many."""
    states = [_State(camera, baseline_m, window) for window in windows]
    columns, normal = _solve(states, number)
    variance = sum(state.squares for state in states) / max(sum(state.freedom for state in states), 1.0)
    covariance = np.asarray(np.linalg.inv(normal) * (max(variance, 1e-6) * CORRELATED_CORNERS), np.float64)
    covariance = covariance + np.diag(TRACK_FLOOR_PX[:number] ** 2)
    return ColumnFit(columns, covariance, sum(state.window.left.shape[1] for state in states))


def motions_of(camera: Pinhole, baseline_m: float, window: Window) -> list[SE3]:
    """Return T_view_first of the left camera in every instant."""
    state = _State(camera, baseline_m, window)
    _solve([state], NUM_BOW)
    return state.T_view_first


def _solve(states: Sequence[_State], number: int) -> tuple[Array, Array]:
    """Move all states to what explains their pixels; return the numbers of the disparity and their information."""
    columns: Array = np.zeros(number)
    normal = prior = np.eye(number) / TRACK_PRIOR_PX**2
    for step in range(TRACK_STEPS):
        scale = TRACK_LOSS_PX * max(8.0 / 2**step, 1.0)
        reduced = [state.reduce(columns, scale) for state in states]
        normal = prior + sum(part.H for part in reduced)
        change = np.asarray(np.linalg.solve(normal, sum(part.b for part in reduced) - prior @ columns), np.float64)
        columns = columns + change
        for state, part in zip(states, reduced, strict=True):
            state.move(part, change)
    return columns, normal


@dataclass(frozen=True, eq=False)
class _Reduced:
    """Normal equations of the C numbers of one window, and what gives back its motions and depths."""

    H: Array  # (C, C)
    b: Array  # (C,)
    poses: tuple[Array, Array]  # solved for the motions: (6 (K - 1),) and (6 (K - 1), C) by the numbers
    depths: tuple[Array, Array, Array]  # (N,), (N, 6 (K - 1)), (N, C)


class _State:
    """Motions T_view_first and inverse depths of one window."""

    def __init__(self, camera: Pinhole, baseline_m: float, window: Window) -> None:
        self.camera, self.baseline_m, self.window = camera, baseline_m, window
        self.seen = ~np.isnan(window.right_u)
        x, y = tangents(camera, window.left[0])
        self.rays = np.stack([x, y, np.ones_like(x)], axis=-1)
        self.inverse = (window.left[0, :, 0] - window.right_u[0]) / (camera.fx * baseline_m)
        self.T_view_first = [SE3.identity()] * len(window.left)
        self.squares = self.freedom = 0.0

    def reduce(self, columns: Array, scale: float) -> _Reduced:
        """Linearize all pixels, eliminate depths, then motions."""
        r, J_columns, J_inverse, J_poses = self._linearize(columns)
        for part in (r, J_columns, J_inverse, J_poses):
            part[~self.seen] = 0.0
        size, views, squares = J_poses.shape[-1], self.seen.sum(axis=0), np.sum(r * r, axis=(0, 2))
        weight = cauchy_weights(squares / (views * scale**2))  # (N,), of the whole corner
        self.squares = float(weight @ squares)
        self.freedom = float(np.sum(weight * (3 * views - 3))) - size
        J = np.concatenate([J_columns, J_poses], axis=-1)  # (K, N, 3, C + 6 (K - 1))
        W = weight[:, None]
        D = weight * np.sum(J_inverse**2, axis=(0, 2)) + 1e-9
        E = W * np.einsum("kni,knij->nj", J_inverse, J)
        g = weight * np.einsum("kni,kni->n", J_inverse, r)
        weighted = (W[:, None] * J).reshape(-1, J.shape[-1])
        H = weighted.T @ J.reshape(weighted.shape) - (E / D[:, None]).T @ E
        b = E.T @ (g / D) - weighted.T @ r.ravel()
        n = len(columns)
        poses = np.linalg.solve(H[n:, n:] + 1e-9 * np.eye(size), np.column_stack([b[n:], H[n:, :n]]))
        depths = (-g / D, E[:, n:] / D[:, None], E[:, :n] / D[:, None])
        return _Reduced(
            H[:n, :n] - H[:n, n:] @ poses[:, 1:], b[:n] - H[:n, n:] @ poses[:, 0], (poses[:, 0], poses[:, 1:]), depths
        )

    def move(self, part: _Reduced, change: Array) -> None:
        """Take the step that belongs to a change of the numbers."""
        motion = part.poses[0] - part.poses[1] @ change
        self.inverse = self.inverse + part.depths[0] - part.depths[1] @ motion - part.depths[2] @ change
        self.inverse = np.maximum(self.inverse, 1e-4)
        for k in range(1, len(self.T_view_first)):
            self.T_view_first[k] = SE3.exp(motion[6 * (k - 1) : 6 * k]) @ self.T_view_first[k]

    def _linearize(self, columns: Array) -> tuple[Array, Array, Array, Array]:
        """Return residuals (K, N, 3) of u, v and the right u, and their derivatives by columns, depth, motions."""
        camera, K = self.camera, len(self.T_view_first)
        shape = (K, len(self.rays), 3)
        r, J_inverse = np.zeros(shape), np.zeros(shape)
        J_columns, J_poses = np.zeros((*shape, len(columns))), np.zeros((*shape, 6 * (K - 1)))
        for k, T in enumerate(self.T_view_first):
            p = self.rays @ T.rotation.T + T.translation * self.inverse[:, None]  # point by its inverse depth
            p[:, 2] = np.maximum(p[:, 2], 1e-3)
            p_right = p - np.outer(self.inverse, (self.baseline_m, 0.0, 0.0))
            (left, _), (right, _) = camera.project(p), camera.project(p_right)
            place = tangents(camera, right)
            basis = basis_of_columns(*place)[:, : len(columns)]
            by_x, by_y = (part[:, : len(columns)] @ columns for part in slopes_of_columns(*place))
            r[k, :, :2] = left - self.window.left[k]
            r[k, :, 2] = right[:, 0] + basis @ columns - self.window.right_u[k]
            by_right = np.column_stack([1 + by_x / camera.fx, by_y / camera.fy])  # of the right column by its pixel
            by_point = np.concatenate(
                [camera.J_project(p), np.einsum("ni,nij->nj", by_right, camera.J_project(p_right))[:, None]], axis=1
            )
            J_inverse[k] = by_point @ T.translation
            J_inverse[k, :, 2] -= by_point[:, 2, 0] * self.baseline_m
            J_columns[k, :, 2] = basis
            if k:
                J_poses[k, :, :, 6 * k - 6 : 6 * k - 3] = by_point * self.inverse[:, None, None]
                J_poses[k, :, :, 6 * k - 3 : 6 * k] = -by_point @ so3.hat(p)
        return r, J_columns, J_inverse, J_poses
