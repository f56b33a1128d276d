"""Pictures of a drive."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np

from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav_tools.cli.demo.report import DriveErrors

mpl.use("Agg")
from matplotlib import pyplot as plt

EXAGGERATION = 50  # of the distance between two paths that no eye could tell apart


def plot_top_view(path: Path, errors: DriveErrors, key_spheres: np.ndarray) -> None:
    """Draw the taught path, the driven one beside it and the key spheres (K, 2) from above, metres.

    The driven path is `EXAGGERATION` times as far from the taught one as the car truly was.
    """
    figure, axes = plt.subplots(figsize=(8, 8))
    axes.plot(*errors.taught.T, "-", color="0.6", linewidth=3, label="taught (truth)")
    label = f"driven by the camera (truth), its distance from the taught path × {EXAGGERATION}"
    axes.plot(*exaggerate(errors, EXAGGERATION).T, "-", color="tab:red", linewidth=1.2, label=label)
    axes.plot(*key_spheres.T, "o", color="tab:blue", markersize=4, label=f"{len(key_spheres)} key spheres")
    axes.plot(*errors.driven[0], "^", color="black", markersize=9, label="start")
    worst = 100 * np.abs(errors.lateral).max()
    title = f"Taught and driven path, at most {worst:.1f} cm apart"
    axes.set(aspect="equal", adjustable="datalim", xlabel="x [m]", ylabel="y [m]", title=title)
    axes.grid(alpha=0.3)
    axes.legend()
    save_figure(figure, path)


def exaggerate(errors: DriveErrors, factor: float) -> np.ndarray:
    """Return the driven positions (N, 2) with their distance from the taught path multiplied."""
    steps = np.hypot(*np.diff(errors.taught, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    ahead = np.gradient(errors.taught, axis=0)
    place, direction = (
        np.stack([np.interp(errors.along, along, values[:, axis]) for axis in (0, 1)], axis=-1)
        for values in (errors.taught, ahead)
    )
    direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-12)
    left = np.stack([-direction[:, 1], direction[:, 0]], axis=-1)
    return place + factor * errors.lateral[:, None] * left


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
    save_figure(figure, path)


def save_figure(figure: plt.Figure, path: Path) -> None:
    """Write a figure and forget it."""
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    plt.close(figure)
