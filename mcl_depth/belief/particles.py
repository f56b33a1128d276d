"""Hypotheses of where `level` is: the camera's centre, with the levelled axes of the vehicle.

What the curve of similarities over all headings tells about the heading (N17 section III-C).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mcl_depth.constants import HEADING_SPREAD, NUM_YOUNG
from sphere_nav.geometry.arrays import Array


@dataclass(frozen=True)
class Particles:
    """A weighted set: `poses` (N, 3) are x, y in m and yaw in rad in the map; `weights` (N,) sum to 1."""

    poses: Array
    weights: Array
    ages: NDArray[np.int64]  # (N,) images seen since the particle was spread

    def __len__(self) -> int:
        return len(self.poses)

    @staticmethod
    def of_equal_weight(poses: Array, ages: int | NDArray[np.int64] = 0) -> Particles:
        """Return particles of one weight; `ages` of all, or of each."""
        count = len(poses)
        return Particles(poses, np.full(count, 1.0 / max(count, 1)), np.full(count, ages, dtype=np.int64))

    @property
    def effective_size(self) -> float:
        """1 / sum of squared weights: how many particles carry the belief."""
        return float(1.0 / np.sum(self.weights**2))

    def reweight(self, weights: Array) -> Particles:
        """Return the same particles, one image older, with weights scaled to sum 1."""
        return replace(self, weights=weights / weights.sum(), ages=self.ages + 1)


def wrap_angle(angle: Array) -> Array:
    """Return angles in rad in [-pi, pi)."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def best_headings(curves: NDArray[np.floating]) -> Array:
    """Return the best heading (N,) rad of curves (N, A), between the steps by a parabola through three of them."""
    count = curves.shape[1]
    best = np.argmax(curves, axis=1)
    rows = np.arange(len(curves))
    before, at, after = (curves[rows, (best + shift) % count].astype(np.float64) for shift in (-1, 0, 1))
    bend = before - 2.0 * at + after
    offset = np.where(bend < 0.0, 0.5 * (before - after) / np.where(bend < 0.0, bend, 1.0), 0.0)
    return wrap_angle((best + np.clip(offset, -0.5, 0.5)) * (2.0 * np.pi / count))


def interpolate_similarity(curves: NDArray[np.floating], headings: Array) -> Array:
    """Return the similarity (N,) at headings (N,) rad, linear between the steps of curves (N, A)."""
    count = curves.shape[1]
    place = (headings / (2.0 * np.pi) * count) % count
    first = np.floor(place).astype(np.int64) % count
    share = place - np.floor(place)
    rows = np.arange(len(curves))
    return (1.0 - share) * curves[rows, first] + share * curves[rows, (first + 1) % count]


def adjust_headings(particles: Particles, curves: NDArray[np.floating], rng: np.random.Generator) -> Particles:
    """Turn young particles to their best heading, which keeps a small spread (algorithm 2, line 19)."""
    is_young = particles.ages < NUM_YOUNG
    if not is_young.any():
        return particles
    poses = particles.poses.copy()
    spread = HEADING_SPREAD * rng.standard_normal(len(particles))
    poses[:, 2] = np.where(is_young, wrap_angle(best_headings(curves) + spread), poses[:, 2])
    return replace(particles, poses=poses)
