"""Robust adjustment: Huber's weights first, then false corners and views out, again and again, then plain squares."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rig_calibration.boards.bundle import AdjustmentProblem, RigState, residuals, rms_px, solve
from rig_calibration.boards.views import Observations
from rig_calibration.constants import (
    CORNER_LIMIT,
    FLOOR_RATIO,
    MAX_ROUNDS,
    MIN_FITTING,
    MIN_RESIDUAL_PX,
    MIN_SEEN,
    VIEW_RATIO,
)
from sphere_nav.estimation.least_squares import HUBER
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.trajectory_error import MEDIAN_LENGTHS


@dataclass(frozen=True, eq=False)
class Adjusted:
    """A state, its residuals (N, 2), weights (N,) 0 or 1 of corners, and why views were left out, by their index."""

    state: RigState
    residuals: Array
    kept: Array
    dropped: dict[int, str]


def adjust(
    problem: AdjustmentProblem,
    start: RigState,
    kept: Array,
    progress: Callable[[str], None] = lambda _: None,
) -> Adjusted:
    """Adjust until the same corners are rejected; those that come with weight 0, and views once left out, stay out."""
    seen, allowed, state, errors = problem.seen, kept, start, residuals(problem, start)
    dropped: dict[int, str] = {}
    for number in range(MAX_ROUNDS):
        state, errors = solve(problem, state, kept, HUBER * noise_px(errors, kept), max_iterations=25)
        progress(f"adjusting, round {number + 1}: {rms_px(errors, kept):.3f} px")
        before = kept
        kept, found = reject(seen, errors, allowed)
        dropped |= found
        allowed = np.where(np.isin(seen.view, list(dropped)), 0.0, allowed)
        if number > 0 and np.array_equal(kept, before):
            break
    return Adjusted(*solve(problem, state, kept), kept, dropped)


def reject(seen: Observations, errors: Array, kept: Array) -> tuple[Array, dict[int, str]]:
    """Return which corners (N,) remain, and the views that are left out with the reason.

    A corner is judged by the scatter of its camera, from medians that half of all corners being false does not move.
    A view is judged by its median corner, so that a few false ones cost no more than themselves. A false view pulls
    the rig pose of its instant and with it the other views there: of one instant only the worst goes at a time.
    """
    remaining = kept.copy()
    size = np.linalg.norm(np.nan_to_num(errors, nan=1e6), axis=-1)
    typical = view_medians(seen, size, kept)
    excess, usual = np.zeros(seen.num_views), np.zeros(seen.num_views)
    for camera, rows in seen.camera_slices:
        own = np.flatnonzero((seen.camera == camera) & np.isfinite(typical))
        if not own.size:
            continue
        usual[own] = np.median(typical[own])
        excess[own] = typical[own] / np.maximum(VIEW_RATIO * usual[own], FLOOR_RATIO * MIN_RESIDUAL_PX)
        limit = max(CORNER_LIMIT * noise_px(errors[rows], kept[rows]), MIN_RESIDUAL_PX)
        is_false = (size[rows] > limit) & (excess[seen.view[rows]] <= 1.0)
        remaining[rows] = np.where(is_false, 0.0, remaining[rows])
    dropped = {}
    for view in _worst_of_instants(seen, excess):
        remaining[seen.view == view] = 0.0
        dropped[view] = f"median residual {typical[view]:.2f} px, others of this camera {usual[view]:.2f} px"
    return _drop_poor(seen, remaining, kept, dropped)


def view_medians(seen: Observations, size: Array, kept: Array) -> Array:
    """Return the median (V,) of the lengths (N,) of the residuals of each view, NaN where no corner counts."""
    counted = [size[rows][kept[rows] > 0] for rows in seen.rows]
    return np.array([np.median(own) if own.size else np.nan for own in counted])


def _worst_of_instants(seen: Observations, excess: Array) -> list[int]:
    """Return the views over their limit, of each instant the one that is most."""
    over = np.flatnonzero(excess > 1.0)
    worst_first = over[np.argsort(-excess[over], kind="stable")]
    _, first = np.unique(seen.instant[worst_first], return_index=True)
    return sorted(worst_first[first].tolist())


def noise_px(errors: Array, kept: Array) -> float:
    """Return a robust standard deviation of one coordinate of the residuals (N, 2), never quite zero."""
    size = np.linalg.norm(errors[kept > 0], axis=-1)
    return max(float(np.median(size)) / MEDIAN_LENGTHS[2], 1e-9) if size.size else 1e-9


def _drop_poor(
    seen: Observations, remaining: Array, kept: Array, dropped: dict[int, str]
) -> tuple[Array, dict[int, str]]:
    count = np.bincount(seen.view, remaining, minlength=seen.num_views)
    before = np.bincount(seen.view, kept, minlength=seen.num_views)
    least = np.maximum(MIN_SEEN, MIN_FITTING * seen.counts)
    for view in np.flatnonzero((count < least) & (before > 0)):
        remaining[seen.view == view] = 0.0
        dropped.setdefault(int(view), f"{count[view]:.0f} of {seen.counts[view]:.0f} corners fit")
    return remaining, dropped
