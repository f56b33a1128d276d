"""A picture of a drive beside the taught one."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sphere_nav.geometry.arrays import Array
from sphere_nav_tools.cli.demo.report import DriveErrors
from sphere_nav_tools.offline.plot_figure import drawn, top_view

EXAGGERATION = 50  # of the distance between two paths that no eye could tell apart


def plot_top_view(path: Path, errors: DriveErrors, key_spheres: Array) -> None:
    """Draw the taught path, the driven one beside it and the key spheres (K, 2) from above, metres.

    The driven path is `EXAGGERATION` times as far from the taught one as the car truly was.
    """
    label = f"driven by the camera (truth), its distance from the taught path × {EXAGGERATION}"
    taught = np.stack([errors.taught.x, errors.taught.y], axis=1)
    with drawn(path, (8, 8)) as figure:
        axes = figure.add_subplot()
        lines = {"taught (truth)": taught, label: exaggerate(errors, EXAGGERATION)}
        top_view(axes, lines, {f"{len(key_spheres)} key spheres": key_spheres})
        axes.set_title(f"Taught and driven path, at most {100 * np.abs(errors.lateral).max():.1f} cm apart", loc="left")


def exaggerate(errors: DriveErrors, factor: float) -> Array:
    """Return the driven positions (N, 2) with their distance from the taught path multiplied."""
    feet = [errors.taught.at(along, 0) for along in errors.along]
    left = np.array([(-np.sin(foot.yaw), np.cos(foot.yaw)) for foot in feet])
    return np.array([(foot.x, foot.y) for foot in feet]) + factor * errors.lateral[:, None] * left
