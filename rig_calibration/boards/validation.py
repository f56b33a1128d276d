"""How good the rig is on images it was not made from, and how alike it comes out of two halves of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rig_calibration.boards.bundle import AdjustmentProblem, RigState, residuals, rms_px, solve
from rig_calibration.boards.rejection import noise_px
from rig_calibration.constants import HELD_OUT_EVERY, MIN_VIEWS
from sphere_nav.geometry import so3
from sphere_nav.geometry.arrays import Array, Flags


@dataclass(frozen=True, eq=False)
class Validation:
    """Per camera: held-out RMS (C,) in pixels, and the difference (C, 6) between halves in metres and radians.

    NaN where too few images are left. Differences are along and about the axes of the rig. focal_halves (C,): how much
    longer the focal length of the second half is, relative.
    """

    held_out_px: Array
    halves: Array
    focal_halves: Array


def validate(problem: AdjustmentProblem, state: RigState, kept: Array) -> Validation:
    """Repeat the calibration on parts of the instants."""
    number = np.arange(len(state.T_world_rig.matrix))
    is_held = number % HELD_OUT_EVERY == HELD_OUT_EVERY - 1
    held_out = _hold_out(problem, state, kept, is_held)
    halves = [_part(problem, state, kept, number % 2 == half) for half in (0, 1)]
    states = [half for half in halves if half is not None]
    if len(states) < 2:
        unknown = np.full((len(problem.models), 6), np.nan)
        return Validation(held_out, unknown, unknown[:, 0])
    focal = [[problem.camera(half, i).pixels_per_radian for i in range(len(problem.models))] for half in states]
    return Validation(held_out, _difference(*states), np.divide(focal[1], focal[0]) - 1.0)


def camera_rms(problem: AdjustmentProblem, errors: Array, kept: Array) -> Array:
    """Return the RMS (C,) of each camera over the corners that count, NaN without any."""
    found = np.full(len(problem.models), np.nan)
    for camera, rows in problem.seen.camera_slices:
        found[camera] = rms_px(errors[rows], kept[rows])
    return found


def _hold_out(problem: AdjustmentProblem, state: RigState, kept: Array, is_held: Flags) -> Array:
    """Calibrate without some instants, then find only where the rig was at these."""
    rest = _part(problem, state, kept, ~is_held)
    if rest is None or not is_held.any():
        return np.full(len(problem.models), np.nan)
    weights = kept * is_held[problem.seen.instant[problem.seen.view]]
    still = problem.held()
    try:
        huber_px = 3.0 * noise_px(residuals(still, rest), weights)
        _, errors = solve(still, rest, weights, huber_px)
    except ValueError:  # a point behind a camera
        return np.full(len(problem.models), np.nan)
    return camera_rms(problem, errors, weights)


def _part(problem: AdjustmentProblem, state: RigState, kept: Array, is_used: Flags) -> RigState | None:
    """Calibrate from some instants (I,); None where a camera has too few views among them."""
    seen = problem.seen
    weights = kept * is_used[seen.instant[seen.view]]
    views = np.bincount(seen.view, weights, minlength=seen.num_views) > 0
    count = np.bincount(seen.camera[views], minlength=len(problem.models))
    if count.min() < MIN_VIEWS:
        return None
    return solve(problem, state, weights)[0]


def _difference(first: RigState, second: RigState) -> Array:
    moved = second.T_rig_camera.translation - first.T_rig_camera.translation
    turn = so3.log(second.T_rig_camera.rotation @ np.swapaxes(first.T_rig_camera.rotation, -1, -2))
    return np.concatenate([moved, turn], axis=-1)
