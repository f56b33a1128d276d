"""The matched filter orders places and headings as eq. 2 does, and a known place stands out more."""

from __future__ import annotations

import numpy as np

from mcl_depth.likeness.comparison import similarity_many
from mcl_depth.likeness.features import GradientFeatures, depth_features_many
from mcl_depth.likeness.matched_filter import MatchedFilter
from mcl_depth.params import ComparisonParams
from worlds.panoramas import NUM_HEADINGS, WIDTH, depth_features, rooms, square_room

NUM_CELLS = 300


def image_of(ranges, cell, heading):
    """What a camera that sees depth itself would make of a place; `heading` in steps."""
    features = depth_features(ranges[cell], ComparisonParams())
    shift = heading * WIDTH // NUM_HEADINGS
    return GradientFeatures(*(np.roll(part, shift, axis=1) for part in (features.x, features.y, features.magnitude)))


def test_place_and_heading_are_those_of_eq_2():
    ranges = rooms(square_room(), NUM_CELLS, 5)
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
