"""The plot of `sphere_nav evaluate`: top view, and errors over time."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.geometry.trajectory_error import AbsoluteErrors

TRUTH, ESTIMATE, LATERAL, LONGITUDINAL, ROTATION = "#9aa0a6", "#1f77b4", "#d62728", "#2ca02c", "#8c564b"


def draw_evaluation(
    estimate: Trajectory, truth: Trajectory, all_truth: Trajectory, errors: AbsoluteErrors, path: Path
) -> None:
    """Draw paired trajectories (N,) and their errors into a file; the ending chooses the format."""
    with mpl.rc_context({"font.size": 9, "axes.grid": True, "grid.alpha": 0.3}):
        figure = Figure(figsize=(12, 6), layout="constrained")
        cells = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.3))
        _top_view(figure.add_subplot(cells[:, 0]), estimate, all_truth)
        upper, lower = figure.add_subplot(cells[0, 1]), figure.add_subplot(cells[1, 1])
        seconds = (truth.stamps_ns - truth.stamps_ns[0]) / 1e9
        upper.plot(seconds, errors.lateral_m, color=LATERAL, lw=1, label="lateral (left)")
        upper.plot(seconds, errors.longitudinal_m, color=LONGITUDINAL, lw=1, label="longitudinal (ahead)")
        upper.set_ylabel("error [m]")
        lower.plot(seconds, np.degrees(errors.rotation_rad), color=ROTATION, lw=1, label="rotation [°]")
        lower.plot(seconds, errors.translation_m, color=ESTIMATE, lw=1, label="translation [m]")
        lower.set_ylabel("absolute error")
        lower.set_xlabel("time [s]")
        upper.legend(loc="upper right")
        lower.legend(loc="upper right")
        figure.savefig(path, dpi=120)


def _top_view(axes: mpl.axes.Axes, estimate: Trajectory, truth: Trajectory) -> None:
    axes.plot(*truth.positions[:, :2].T, color=TRUTH, lw=4, label="truth")
    axes.plot(*estimate.positions[:, :2].T, ".-", color=ESTIMATE, lw=1, ms=2, label="estimate")
    axes.plot(*truth.positions[0, :2], "o", color="black", ms=5, label="start")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.legend(loc="best")
