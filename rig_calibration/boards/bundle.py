"""Bundle adjustment: Levenberg-Marquardt over lenses, cameras, boards and rig poses, the latter eliminated first.

Each rig pose appears in the views of its own instant only, so that the normal equations
[A B; B^T C] have C block-diagonal: the Schur complement A - B C^-1 B^T is as small as the rig itself, and it is also
the information that the images carry about the rig.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from rig_calibration.boards.linearize import Normal, normal_equations, residuals
from rig_calibration.boards.state import AdjustmentProblem, RigState
from rig_calibration.constants import FIRST_DAMPING, MAX_DAMPING, MIN_GAIN
from sphere_nav.estimation.robust import huber_weights
from sphere_nav.geometry.arrays import TINY, Array


@dataclass(frozen=True, eq=False)
class Solution:
    """The best state found, its residuals (N, 2) in pixels, its cost in square pixels, and whether it settled."""

    state: RigState
    residuals: Array
    cost: float
    is_converged: bool


def solve(
    problem: AdjustmentProblem, start: RigState, weights: Array, huber_px: float = np.inf, max_iterations: int = 60
) -> Solution:
    """Minimise the weighted squares, linear beyond `huber_px`. Corners (N,) of weight 0 do not count."""
    state, damping, is_converged = start, FIRST_DAMPING, False
    errors = residuals(problem, state)
    cost = _cost(errors, weights, huber_px)
    if not np.isfinite(cost):
        raise ValueError("bundle adjustment: expected a start with all boards in front of their cameras")
    for _ in range(max_iterations):
        weighted = weights * huber_weights(np.linalg.norm(np.nan_to_num(errors), axis=-1), huber_px)
        normal = normal_equations(problem, state, np.nan_to_num(errors), weighted)
        while damping < MAX_DAMPING:
            trial = state.moved(*_step(problem, normal, damping))
            trial_errors = residuals(problem, trial)
            trial_cost = _cost(trial_errors, weights, huber_px) if np.all(trial.lenses[:, :2] > 0) else np.inf
            if trial_cost <= cost:
                break
            damping *= 8.0
        else:
            is_converged = True
            break
        is_converged = cost - trial_cost <= MIN_GAIN * cost + TINY * TINY
        state, errors, cost, damping = trial, trial_errors, trial_cost, max(damping / 8.0, TINY)
        if is_converged:
            break
    return Solution(state, errors, cost, is_converged)


def information(problem: AdjustmentProblem, state: RigState, weights: Array) -> Array:
    """Return the information (S, S) about the shared parameters, in units of one pixel; zeros for held ones."""
    normal = normal_equations(problem, state, np.nan_to_num(residuals(problem, state)), weights)
    reduced, _, _ = _eliminate(normal, 0.0)
    return reduced


def _cost(errors: Array, weights: Array, huber_px: float) -> float:
    size = np.linalg.norm(errors[weights > 0], axis=-1)
    if not np.all(np.isfinite(size)):
        return float("inf")
    quadratic = np.minimum(size, huber_px)
    linear = np.where(size > huber_px, 2.0 * quadratic * (size - quadratic), 0.0)
    return float(weights[weights > 0] @ (quadratic**2 + linear))


def _eliminate(normal: Normal, damping: float) -> tuple[Array, Array, Array]:
    """Return the Schur complement (S, S), its right side (S,), and C^-1 [B^T, g] (I, 6, S + 1)."""
    identity = np.eye(6)
    poses = normal.poses * (1.0 + damping * identity)
    poses = poses + identity * np.where(np.trace(normal.poses, axis1=1, axis2=2) > 0, TINY, 1.0)[:, None, None]
    right = np.concatenate([normal.mixed.transpose(1, 2, 0), normal.pose_gradients[:, :, None]], axis=-1)
    solved = np.linalg.solve(poses, right)
    num_shared = len(normal.gradient)
    product = normal.mixed.reshape(num_shared, -1) @ solved.reshape(-1, num_shared + 1)
    shared = normal.shared + damping * np.diag(np.diag(normal.shared))
    return shared - product[:, :-1], normal.gradient - product[:, -1], solved


def _step(problem: AdjustmentProblem, normal: Normal, damping: float) -> tuple[Array, Array]:
    reduced, right, solved = _eliminate(normal, damping)
    free = np.flatnonzero(problem.is_free & (np.diag(normal.shared) > 0))
    shared = np.zeros(len(right))
    if free.size:
        inner = reduced[np.ix_(free, free)]
        scale = 1.0 / np.sqrt(np.diag(normal.shared)[free])
        scaled = inner * scale * scale[:, None] + TINY * np.eye(len(free))
        shared[free] = -scale * _solve(scaled, scale * right[free])
    poses = -(solved[:, :, -1] + solved[:, :, :-1] @ shared)
    return shared, poses


def _solve(matrix: Array, right: Array) -> Array:
    """Solve by Cholesky, or by the smallest of all solutions where the images leave an axis open."""
    try:
        found: Array = linalg.cho_solve(linalg.cho_factor(matrix, check_finite=False), right, check_finite=False)
    except linalg.LinAlgError:
        found = linalg.lstsq(matrix, right, check_finite=False)[0]
    return found
