"""Pictures of a drive."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np

from sphere_geometry.trajectory import Trajectory
from sphere_nav_cli.driving.report import DriveErrors

mpl.use("Agg")
from matplotlib import pyplot as plt


def plot_top_view(path: Path, errors: DriveErrors, key_spheres: np.ndarray) -> None:
    """Draw the taught and the driven path and the key spheres (K, 2) from above, metres."""
    figure, axes = plt.subplots(figsize=(8, 8))
    axes.plot(*errors.taught.T, "-", color="0.6", linewidth=5, label="taught (truth)")
    axes.plot(*errors.driven.T, "-", color="tab:red", linewidth=1.2, label="driven by the camera (truth)")
    axes.plot(*key_spheres.T, "o", color="tab:blue", markersize=4, label=f"{len(key_spheres)} key spheres")
    axes.plot(*errors.driven[0], "^", color="black", markersize=9, label="start")
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title="Taught and driven path")
    axes.grid(alpha=0.3)
    axes.legend()
    _save(figure, path)


def plot_errors(path: Path, errors: DriveErrors, poses: Trajectory) -> None:
    """Draw the lateral error along the path and the longitudinal error of the localisation over time."""
    figure, (upper, lower) = plt.subplots(2, 1, figsize=(9, 6))
    upper.axhline(0.0, color="0.8")
    upper.plot(errors.along, 100 * errors.lateral, color="tab:red")
    upper.set(xlabel="place on the taught path [m]", ylabel="lateral error [cm]", title="Truth against the taught path")
    seconds = (poses.stamps_ns[: len(errors.longitudinal)] - poses.stamps_ns[0]) / 1e9
    lower.axhline(0.0, color="0.8")
    lower.plot(seconds, 100 * errors.longitudinal, color="tab:blue")
    lower.set(xlabel="time [s]", ylabel="longitudinal error [cm]", title="Localisation against the truth")
    for axes in (upper, lower):
        axes.grid(alpha=0.3)
    _save(figure, path)


def _save(figure: plt.Figure, path: Path) -> None:
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    plt.close(figure)
