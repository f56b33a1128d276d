"""Bundle adjustment: Levenberg-Marquardt over lenses, where cameras sit, where boards hang, where the rig was.

A corner P of board b, seen by camera c at instant i, lies at p = X_c^-1 R_i^-1 B_b P in the camera, with
X = T_rig_camera, R = T_world_rig, B = T_world_board. It depends on one camera, one board and one rig pose, so that the
derivatives by the same number of all cameras (boards, rig poses) come from one difference.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array
from scipy.special import huber

from rig_calibration.boards.views import Observations
from rig_calibration.constants import DIFFERENCE, FIRST_DAMPING, MAX_DAMPING, MIN_GAIN, NUM_DISTORTION
from sphere_nav.estimation.least_squares import huber_weights
from sphere_nav.geometry import SE3, Camera, so3
from sphere_nav.geometry.arrays import TINY, Array, Flags
from sphere_nav.geometry.cameras.lens import NUM_LENS, camera_of, free_parameters

SHARED = NUM_LENS + 6  # parameters of a camera: lens, then along and about the axes of the rig


@dataclass(frozen=True, eq=False)
class RigState:
    """Lenses (C, 12), `T_rig_camera` (C,), `T_world_board` (B,) and `T_world_rig` (I,), one for every instant."""

    lenses: Array
    T_rig_camera: SE3
    T_world_board: SE3
    T_world_rig: SE3

    def moved(self, step: Array) -> RigState:
        """Add a step (18 C + 6 B + 6 I,) of cameras, boards and rig poses.

        Cameras move along and turn about the axes of the rig; tangents of the others act from the right.
        """
        lenses, boards = SHARED * len(self.lenses), 6 * len(self.T_world_board.matrix)
        lens, move, turn = np.split(step[:lenses].reshape(-1, SHARED), [NUM_LENS, NUM_LENS + 3], axis=1)
        return RigState(
            self.lenses + lens,
            SE3.from_parts(so3.exp(turn) @ self.T_rig_camera.rotation, self.T_rig_camera.translation + move),
            self.T_world_board @ SE3.exp(step[lenses : lenses + boards].reshape(-1, 6)),
            self.T_world_rig @ SE3.exp(step[lenses + boards :].reshape(-1, 6)),
        )


@dataclass(frozen=True, eq=False)
class AdjustmentProblem:
    """Observations, and which of the shared parameters (18 C + 6 B,) may move; rig poses always may."""

    models: tuple[str, ...]
    sizes: tuple[tuple[int, int], ...]
    seen: Observations
    is_free: Flags

    @property
    def num_shared(self) -> int:
        """Number of the shared parameters."""
        return len(self.is_free)

    def camera(self, state: RigState, index: int) -> Camera:
        """Return a camera as its model."""
        return camera_of(self.models[index], self.sizes[index], state.lenses[index], NUM_DISTORTION)

    def held(self) -> AdjustmentProblem:
        """Return the problem with all shared parameters held."""
        return replace(self, is_free=np.zeros_like(self.is_free))


def rig_problem(
    models: tuple[str, ...],
    sizes: tuple[tuple[int, int], ...],
    seen: Observations,
    num_boards: int = 1,
    reference_board: int = 0,
) -> AdjustmentProblem:
    """Return the whole problem; the first camera and one board stay where they are, to hold rig and world."""
    lenses = [free_parameters(model, NUM_DISTORTION) for model in models]
    cameras = [np.concatenate([lens, np.full(6, index > 0)]) for index, lens in enumerate(lenses)]
    boards = [np.full(6, index != reference_board) for index in range(num_boards)]
    return AdjustmentProblem(models, sizes, seen, np.concatenate([*cameras, *boards]))


def camera_state(lens: Array, T_camera_board: SE3) -> RigState:
    """Return the state of a rig of one camera; a rig pose is the camera's in the frame of the board it sees."""
    origin = SE3(np.eye(4)[None])
    return RigState(lens[None], origin, origin, T_camera_board.inverse())


def solve(
    problem: AdjustmentProblem, start: RigState, weights: Array, huber_px: float = np.inf, max_iterations: int = 60
) -> tuple[RigState, Array]:
    """Return the state with the least weighted squares, linear beyond `huber_px`, and its residuals (N, 2).

    Corners (N,) of weight 0 do not count.
    """
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
    return state, errors


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
    seen = problem.seen
    T_camera_world = (state.T_world_rig[seen.instant] @ state.T_rig_camera[seen.camera]).inverse()
    T = (T_camera_world @ state.T_world_board[seen.board])[seen.view]
    points = np.einsum("nij,nj->ni", T.rotation, seen.points) + T.translation
    found = np.full_like(seen.pixels, np.nan)
    for camera, rows in seen.camera_slices:
        with suppress(ValueError):
            found[rows] = problem.camera(state, camera).project(points[rows])[0]
    return found - seen.pixels


def normal_equations(problem: AdjustmentProblem, state: RigState, errors: Array, weights: Array) -> tuple[Array, Array]:
    """Return the weighted J^T J and J^T e of errors (N, 2), by a step (18 C + 6 B + 6 I,); zeros for what is held."""
    seen, boards = problem.seen, SHARED * len(problem.models)
    is_free = np.append(problem.is_free, np.ones(6 * len(state.T_world_rig.matrix), bool))
    firsts = (SHARED * seen.camera, SHARED), (boards + 6 * seen.board, 6), (problem.num_shared + 6 * seen.instant, 6)
    columns = np.concatenate([first[:, None] + np.arange(count) for first, count in firsts], axis=1)
    columns = columns[:, is_free[columns].any(axis=0)]
    J = np.empty((*errors.shape, columns.shape[1]))
    for k, column in enumerate(columns.T):
        step = np.zeros(len(is_free))
        step[column] = DIFFERENCE
        J[..., k] = (residuals(problem, state.moved(step * is_free)) - errors) / DIFFERENCE
    places, ends = np.repeat(columns[seen.view], 2, axis=0), np.arange(0, J.size + 1, J.shape[-1])
    whole = csr_array((np.nan_to_num(J).ravel(), places.ravel(), ends), shape=(errors.size, len(is_free)))
    weighted = whole.multiply(np.repeat(weights, 2)[:, None]).T
    return (weighted @ whole).toarray(), weighted @ errors.ravel()


def _cost(errors: Array, weights: Array, huber_px: float) -> float:
    size = np.linalg.norm(errors[weights > 0], axis=-1)
    if not np.all(np.isfinite(size)):
        return float("inf")
    return float(2.0 * weights[weights > 0] @ huber(huber_px, size))


def _step(H: Array, gradient: Array, damping: float) -> Array:
    """Return the damped step; zeros where nothing is told."""
    scale = 1.0 / np.sqrt(np.where(np.diag(H) > 0, np.diag(H), 1.0))
    scaled = H * scale * scale[:, None] + (damping + TINY) * np.eye(len(H))
    return np.asarray(-scale * np.linalg.solve(scaled, scale * gradient))
