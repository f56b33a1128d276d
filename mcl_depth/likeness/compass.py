"""The visual compass: the heading of the best rotation (N17 section III-C)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

APART = np.radians(20.0)  # a rotation farther from the best one than this is another answer


@dataclass(frozen=True)
class Heading:
    """The camera's heading in the map in radians in (-pi, pi], and how far it can be trusted.

    similarity: of the best rotation. contrast: (best - mean) / standard deviation over all rotations.
    margin: (best - best of the other answers) / (best - mean), 0 (two answers) to about 1 (one).
    """

    yaw: float
    similarity: float
    contrast: float
    margin: float


def heading(similarities: NDArray[np.float32]) -> Heading:
    """Return the heading of similarities (num_alpha,) of eq. 2, between the steps by a parabola through three."""
    s = np.asarray(similarities, np.float64)
    if s.ndim != 1 or s.size < 3 or not np.all(np.isfinite(s)):
        raise ValueError(f"similarities: expected at least 3 finite numbers, found {s.shape}")
    step = 2 * np.pi / s.size
    best = int(np.argmax(s))
    before, peak, after = s[best - 1], s[best], s[(best + 1) % s.size]
    curvature = before - 2 * peak + after
    between = 0.5 * (before - after) / curvature if curvature < 0 else 0.0
    away = np.abs(_wrap((np.arange(s.size) - best) * step)) > max(APART, 1.5 * step)
    rise, spread = peak - s.mean(), s.std()
    if rise <= 0 or not away.any():
        return Heading(float(_wrap(np.array(best * step))), float(peak), 0.0, 0.0)
    yaw = float(_wrap(np.array((best + between) * step)))
    return Heading(yaw, float(peak), float(rise / spread), float((peak - s[away].max()) / rise))


def _wrap(angles: NDArray[Any]) -> NDArray[Any]:
    """Return angles in (-pi, pi]."""
    return -((-angles + np.pi) % (2 * np.pi) - np.pi)
