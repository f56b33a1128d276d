"""The matched filter orders places and headings as eq. 2 does, and a known place stands out more."""

from __future__ import annotations

import numpy as np

from mcl_depth.image_params import ComparisonParams
from mcl_depth.likeness.comparison import Features, depth_features, depth_features_many, similarity_many
from mcl_depth.likeness.matched_filter import MatchedFilter

HEIGHT, WIDTH, NUM_HEADINGS, NUM_CELLS = 16, 72, 36, 300


def rooms(seed=3):
    """Range panoramas (M, H, W) of places with pillars, all of them in a room of one shape."""
    rng = np.random.default_rng(seed)
    azimuth = np.arange(WIDTH) * 2 * np.pi / WIDTH
    walls = 6.0 / np.maximum(np.abs(np.cos(azimuth)), np.abs(np.sin(azimuth)))
    ranges = np.tile(walls, (NUM_CELLS, HEIGHT, 1)).astype(np.float32)
    for panorama in ranges:
        for _ in range(5):
            u, v, width = rng.integers(WIDTH), rng.integers(HEIGHT - 4), rng.integers(2, 9)
            panorama[v : v + 4, (u + np.arange(width)) % WIDTH] = rng.uniform(1.0, 3.0)
    return ranges


def image_of(ranges, cell, heading):
    """What a camera that sees depth itself would make of a place; `heading` in steps."""
    features = depth_features(ranges[cell], ComparisonParams())
    shift = heading * WIDTH // NUM_HEADINGS
    return Features(*(np.roll(part, shift, axis=1) for part in (features.x, features.y, features.magnitude)))


def test_place_and_heading_are_those_of_eq_2():
    ranges = rooms()
    stack = depth_features_many(ranges, ComparisonParams())
    matched = MatchedFilter.of(stack, np.arange(NUM_CELLS))
    for cell, heading in ((7, 0), (120, 5), (299, 31)):
        image = image_of(ranges, cell, heading)
        found = matched.curves(image, NUM_HEADINGS)
        best = np.unravel_index(np.argmax(found), found.shape)
        eq_2 = similarity_many(image, stack, NUM_HEADINGS)
        assert best == np.unravel_index(np.argmax(eq_2), eq_2.shape) == (cell, heading)
        lead, lead_of_eq_2 = ((c.max() - np.delete(c, cell, 0).max()) / c.std() for c in (found, eq_2))
        assert lead > lead_of_eq_2  # what all rooms have in common is weighed down


def test_a_cell_without_ground_fits_nothing():
    stack = depth_features_many(rooms(), ComparisonParams())
    slots = np.arange(NUM_CELLS)
    slots[4] = -1
    curves = MatchedFilter.of(stack, slots).curves(image_of(rooms(), 9, 0), NUM_HEADINGS)
    np.testing.assert_array_equal(curves[4], 0.0)
    assert np.argmax(curves.max(axis=1)) == 9
