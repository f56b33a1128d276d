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
    FIELD_FLOOR_PX,
    FIELD_PRIOR_PX,
    FIT_STEPS,
    NUM_CORRELATED,
    TRACK_LOSS_PX,
)
from sphere_mapping.acquisition.stereo.stereo_field import (
    NUM_BOW,
    NUM_COLUMNS,
    basis_of_columns,
    slopes_of_columns,
    tangents,
)
from sphere_nav.estimation.least_squares import cauchy_weights, gate, squared_mahalanobis
from sphere_nav.geometry import SE3, Pinhole, so3
from sphere_nav.geometry.arrays import TINY, Array


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
    columns, inverse = _solve(states, number)
    variance = sum(state.squares for state in states) / max(sum(state.freedom for state in states), 1.0)
    covariance = inverse * (max(variance, 1e-6) * NUM_CORRELATED) + FIELD_FLOOR_PX**2 * np.eye(number)
    return ColumnFit(columns, covariance, sum(state.window.left.shape[1] for state in states))


def motions_of(camera: Pinhole, baseline_m: float, window: Window) -> list[SE3]:
    """Return T_view_first of the left camera in every instant."""
    state = _State(camera, baseline_m, window)
    _solve([state], NUM_BOW)
    return state.T_view_first


def _solve(states: Sequence[_State], number: int) -> tuple[Array, Array]:
    """Move all states to what explains their pixels; return the numbers of the disparity, and their inverse normal."""
    columns, prior = np.zeros(number), np.eye(number) / FIELD_PRIOR_PX**2
    ends = number + np.cumsum([state.size for state in states])  # of motions, after the numbers
    own = [np.r_[:number, end - state.size : end] for state, end in zip(states, ends, strict=True)]
    H: Array = np.zeros((ends[-1], ends[-1]))
    for step in range(FIT_STEPS):
        H, b = TINY * np.eye(ends[-1]), np.zeros(ends[-1])
        H[:number, :number] += prior
        b[:number] = -prior @ columns
        scale = TRACK_LOSS_PX * max(8.0 / 2**step, 1.0)
        depths = []
        for state, at in zip(states, own, strict=True):
            part, pull, *rest = state.reduce(columns, scale)
            H[np.ix_(at, at)] += part
            b[at] += pull
            depths.append(rest)
        change = np.linalg.solve(H, b)
        columns = columns + change[:number]
        for state, at, rest in zip(states, own, depths, strict=True):
            state.move(change[at], *rest)
    return columns, np.asarray(np.linalg.inv(H)[:number, :number], np.float64)


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

    @property
    def size(self) -> int:
        """Numbers of its motions."""
        return 6 * (len(self.T_view_first) - 1)

    def reduce(self, columns: Array, scale: float) -> tuple[Array, Array, Array, Array]:
        """Return H and b of the C numbers and the motions, depths eliminated: (N,) and (N, C + size) give them back."""
        r, J_inverse, J = self._linearize(columns)
        for part in (r, J_inverse, J):
            part[~self.seen] = 0.0
        views, squares = self.seen.sum(axis=0), np.sum(r * r, axis=(0, 2))
        weight = cauchy_weights(squares / (views * scale**2))  # (N,), of the whole corner
        self.squares = float(weight @ squares)
        self.freedom = float(np.sum(weight * (3 * views - 3))) - self.size
        W = weight[:, None]
        D = weight * np.sum(J_inverse**2, axis=(0, 2)) + TINY
        E = W * np.einsum("kni,knij->nj", J_inverse, J)
        g = weight * np.einsum("kni,kni->n", J_inverse, r)
        weighted = (W[:, None] * J).reshape(-1, J.shape[-1])
        H = weighted.T @ J.reshape(weighted.shape) - (E / D[:, None]).T @ E
        return H, E.T @ (g / D) - weighted.T @ r.ravel(), -g / D, E / D[:, None]

    def move(self, change: Array, depths: Array, by_change: Array) -> None:
        """Take the step that belongs to a change of the numbers and the motions."""
        self.inverse = np.maximum(self.inverse + depths - by_change @ change, 1e-4)
        motions = change[len(change) - self.size :].reshape(-1, 6)
        self.T_view_first[1:] = [SE3.exp(xi) @ T for xi, T in zip(motions, self.T_view_first[1:], strict=True)]

    def _linearize(self, columns: Array) -> tuple[Array, Array, Array]:
        """Return residuals (K, N, 3) of u, v, the right u; their derivatives by depth, by the numbers and motions."""
        camera, C = self.camera, len(columns)
        shape = (len(self.T_view_first), len(self.rays), 3)
        r, J_inverse, J = np.zeros(shape), np.zeros(shape), np.zeros((*shape, C + self.size))
        for k, T in enumerate(self.T_view_first):
            p = self.rays @ T.rotation.T + T.translation * self.inverse[:, None]  # point by its inverse depth
            p[:, 2] = np.maximum(p[:, 2], 1e-3)
            p_right = p - np.outer(self.inverse, (self.baseline_m, 0.0, 0.0))
            (left, _), (right, _) = camera.project(p), camera.project(p_right)
            place = tangents(camera, right)
            basis = basis_of_columns(*place)[:, :C]
            by_x, by_y = (part[:, :C] @ columns for part in slopes_of_columns(*place))
            r[k, :, :2] = left - self.window.left[k]
            r[k, :, 2] = right[:, 0] + basis @ columns - self.window.right_u[k]
            by_right = np.column_stack([1 + by_x / camera.fx, by_y / camera.fy])  # of the right column by its pixel
            by_point = np.concatenate(
                [camera.J_project(p), np.einsum("ni,nij->nj", by_right, camera.J_project(p_right))[:, None]], axis=1
            )
            J_inverse[k] = by_point @ T.translation
            J_inverse[k, :, 2] -= by_point[:, 2, 0] * self.baseline_m
            J[k, :, 2, :C] = basis
            if k:
                own = J[k, ..., C + 6 * k - 6 : C + 6 * k]
                own[..., :3], own[..., 3:] = by_point * self.inverse[:, None, None], -by_point @ so3.hat(p)
        return r, J_inverse, J
