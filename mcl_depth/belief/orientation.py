"""What the curve of similarities over all headings tells about the heading (N17 section III-C)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mcl_depth.belief.particles import Particles, wrap_angle
from mcl_depth.constants import HEADING_SPREAD, NUM_YOUNG
from sphere_nav.geometry.arrays import Array


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
    return particles.with_poses(poses)
