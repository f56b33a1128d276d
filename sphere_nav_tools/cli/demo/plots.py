"""Pictures of a drive."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sphere_nav.geometry.arrays import Array, arc_lengths
from sphere_nav_tools.cli.demo.report import DriveErrors
from sphere_nav_tools.offline.plot_figure import LATERAL, LONGITUDINAL, TRUTH, drawn, legend_above, top_view

EXAGGERATION = 50  # of the distance between two paths that no eye could tell apart


def plot_top_view(path: Path, errors: DriveErrors, key_spheres: Array) -> None:
    """Draw the taught path, the driven one beside it and the key spheres (K, 2) from above, metres.

    The driven path is `EXAGGERATION` times as far from the taught one as the car truly was.
    """
    label = f"driven by the camera (truth), its distance from the taught path × {EXAGGERATION}"
    lines = {"taught (truth)": errors.taught, label: exaggerate(errors, EXAGGERATION)}
    with drawn(path, (8, 8)) as figure:
        axes = figure.add_subplot()
        top_view(axes, lines, {f"{len(key_spheres)} key spheres": key_spheres})
        axes.set_title(f"Taught and driven path, at most {100 * np.abs(errors.lateral).max():.1f} cm apart", loc="left")


def exaggerate(errors: DriveErrors, factor: float) -> Array:
    """Return the driven positions (N, 2) with their distance from the taught path multiplied."""
    along = arc_lengths(errors.taught)
    place, direction = (
        np.stack([np.interp(errors.along, along, values[:, axis]) for axis in (0, 1)], axis=-1)
        for values in (errors.taught, np.gradient(errors.taught, axis=0))
    )
    direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-12)
    left = np.stack([-direction[:, 1], direction[:, 0]], axis=-1)
    return place + factor * errors.lateral[:, None] * left


def plot_errors(path: Path, errors: DriveErrors) -> None:
    """Draw the lateral error along the path, and over time the map's own drift apart from the localiser's error."""
    with drawn(path, (9, 6)) as figure:
        upper, lower = figure.subplots(2, 1)
        upper.plot(errors.along, 100 * errors.lateral, color=LATERAL)
        upper.set(xlabel="place on the taught path [m]", ylabel="lateral error [cm]")
        upper.set_title(f"Truth against the taught path: {len(errors.lateral)} places", loc="left")
        own = errors.longitudinal - errors.drift
        for values, color, name in (
            (own, LONGITUDINAL, "the localiser's error"),
            (errors.drift, TRUTH, "drift of the map"),
        ):
            lower.plot(errors.seconds, 100 * values, color=color, label=name)
        lower.set(xlabel="time [s]", ylabel="longitudinal error [cm]")
        median = 10 * float(np.median(np.abs(100 * own)))
        lower.set_title(f"Along the way: {len(own)} poses, the localiser's median {median:.2g} mm", loc="left")
        legend_above(lower)
