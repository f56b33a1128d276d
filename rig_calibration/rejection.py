"""Robust adjustment: Huber's weights first, then false corners and views out by their residuals, then plain squares."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig_calibration.bundle import Solution, solve
from rig_calibration.linearize import residuals
from rig_calibration.params import CalibrationParams
from rig_calibration.state import Problem, State
from rig_calibration.views import Observations

Array = NDArray[np.float64]

NUM_ROUNDS = 4
MEDIAN_LENGTH = 1.1774  # median length of a residual whose two parts have a standard deviation of 1
FLOOR_RATIO = 3.0  # a view is left out from this multiple of `min_residual_px` on, whatever the others are like


@dataclass(frozen=True, eq=False)
class Adjusted:
    """A solution, the weights (N,) 0 or 1 of the corners, and why views were left out, by their index."""

    solution: Solution
    kept: Array
    dropped: dict[int, str]


def adjust(
    problem: Problem,
    start: State,
    kept: Array,
    params: CalibrationParams,
    progress: Callable[[str], None] = lambda _: None,
) -> Adjusted:
    """Adjust until no corner is rejected any more; corners that come with weight 0 stay out."""
    seen = problem.seen
    dropped: dict[int, str] = {}
    solution = solve(problem, start, kept, _huber_px(problem, start, kept, params), max_iterations=25)
    for number in range(NUM_ROUNDS):
        progress(f"adjusting, round {number + 1}: {_rms(solution.residuals, kept):.3f} px")
        remaining, found = reject(seen, solution.residuals, kept, params)
        dropped |= found
        is_settled = number > 0 and np.array_equal(remaining, kept)
        kept = remaining
        if is_settled:
            break
        huber_px = params.huber_width * noise_px(solution.residuals, kept)
        solution = solve(problem, solution.state, kept, huber_px, max_iterations=25)
    return Adjusted(solve(problem, solution.state, kept), kept, dropped)


def reject(seen: Observations, errors: Array, kept: Array, params: CalibrationParams) -> tuple[Array, dict[int, str]]:
    """Return which corners (N,) remain, and the views that are left out with the reason."""
    remaining = kept.copy()
    dropped: dict[int, str] = {}
    size = np.linalg.norm(np.nan_to_num(errors, nan=1e6), axis=-1)
    view_rms = seen.per_view_rms(np.nan_to_num(errors, nan=1e6), kept)
    for camera, rows in seen.camera_slices:
        own = np.flatnonzero((seen.camera == camera) & np.isfinite(view_rms))
        if not own.size:
            continue
        usual = float(np.median(view_rms[own]))
        limit = max(params.view_ratio * usual, FLOOR_RATIO * params.min_residual_px)
        for view in own[view_rms[own] > limit]:
            remaining[seen.view == view] = 0.0
            dropped[int(view)] = f"RMS {view_rms[view]:.2f} px, others of this camera {usual:.2f} px"
        corner_limit = max(params.corner_limit * noise_px(errors[rows], remaining[rows]), params.min_residual_px)
        remaining[rows] = np.where(size[rows] > corner_limit, 0.0, remaining[rows])
    return _drop_poor(seen, remaining, kept, dropped, params)


def noise_px(errors: Array, kept: Array) -> float:
    """Return a robust standard deviation of one coordinate of the residuals (N, 2), never quite zero."""
    size = np.linalg.norm(errors[kept > 0], axis=-1)
    return max(float(np.median(size)) / MEDIAN_LENGTH, 1e-9) if size.size else 1e-9


def _drop_poor(
    seen: Observations, remaining: Array, kept: Array, dropped: dict[int, str], params: CalibrationParams
) -> tuple[Array, dict[int, str]]:
    count = np.bincount(seen.view, remaining, minlength=seen.num_views)
    before = np.bincount(seen.view, kept, minlength=seen.num_views)
    for view in np.flatnonzero((count < params.min_corners) & (before > 0)):
        remaining[seen.view == view] = 0.0
        dropped.setdefault(int(view), f"{count[view]:.0f} of {before[view]:.0f} corners fit")
    return remaining, dropped


def _huber_px(problem: Problem, start: State, kept: Array, params: CalibrationParams) -> float:
    return params.huber_width * noise_px(residuals(problem, start), kept)


def _rms(errors: Array, kept: Array) -> float:
    return float(np.sqrt(np.sum(errors[kept > 0] ** 2) / max(int(np.count_nonzero(kept)), 1)))
