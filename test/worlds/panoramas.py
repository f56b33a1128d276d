"""Small range panoramas of places with pillars, and what a camera that measures depth would make of parts of them."""

from __future__ import annotations

import numpy as np

from mcl_depth.likeness.features import GradientFeatures, depth_gradients
from mcl_depth.params import ComparisonParams

HEIGHT, WIDTH, NUM_HEADINGS = 16, 72, 36


def depth_features(range_m, params):
    """The gradients of a range panorama (H, W) in m, as they are before they are coded."""
    range_m = np.asarray(range_m, np.float32)
    return GradientFeatures(*depth_gradients(range_m, params), np.ones(range_m.shape, np.bool_))


def square_room():
    """Ranges (WIDTH,) of the walls of a square."""
    azimuth = np.arange(WIDTH) * 2 * np.pi / WIDTH
    return 6.0 / np.maximum(np.abs(np.cos(azimuth)), np.abs(np.sin(azimuth)))


def rooms(walls, num_cells, num_pillars):
    """Range panoramas (num_cells, HEIGHT, WIDTH) before walls (WIDTH,), each with its own pillars."""
    rng = np.random.default_rng(3)
    ranges = np.tile(walls, (num_cells, HEIGHT, 1)).astype(np.float32)
    for panorama in ranges:
        for _ in range(num_pillars):
            u, v, width = rng.integers(WIDTH), rng.integers(HEIGHT - 4), rng.integers(2, 9)
            panorama[v : v + 4, (u + np.arange(width)) % WIDTH] = rng.uniform(1.0, 3.0)
    return ranges


def window(left, right):
    """A part of the sphere (HEIGHT, WIDTH) that is no rectangle, columns left to right."""
    is_seen = np.zeros((HEIGHT, WIDTH), np.bool_)
    is_seen[3:14, np.arange(left, right) % WIDTH] = True
    is_seen[3, left % WIDTH] = False  # no rectangle
    return is_seen


def part_of(panorama, heading, is_seen):
    """What a camera that sees depth itself would make of a part; `heading` in steps."""
    features = depth_features(panorama, ComparisonParams())
    shift = heading * WIDTH // NUM_HEADINGS
    parts = [np.roll(a, shift, axis=1) * is_seen for a in (features.x, features.y, features.magnitude)]
    return GradientFeatures(parts[0], parts[1], parts[2] / parts[2].sum(), is_seen)
