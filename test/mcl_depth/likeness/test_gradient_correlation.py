"""The correlation of gradients is the cosine that it says, and finds a part of the sphere."""

from __future__ import annotations

import numpy as np
import pytest

from mcl_depth.constants import MIN_VIEW_SHARE
from mcl_depth.likeness.comparison import GradientFeatures, depth_features, depth_features_many, stack_features
from mcl_depth.likeness.matched_filter import correlate_part
from mcl_depth.params import ComparisonParams
from worlds.panoramas import HEIGHT, NUM_HEADINGS, WIDTH, part_of, rooms, window

NUM_CELLS = 60


def defined(visual, depth, heading):
    """The correlation by its definition, of one place and heading."""
    shift = heading * WIDTH // NUM_HEADINGS
    x, y, m = (np.roll(a, shift, axis=1).astype(np.float64) for a in (depth.x, depth.y, depth.magnitude))
    t_visual = visual.magnitude * (visual.x + 1j * visual.y) ** 2
    t_depth = m * (x + 1j * y) ** 2
    energy = max((np.abs(t_depth[visual.is_seen]) ** 2).sum(),
                 MIN_VIEW_SHARE * visual.is_seen.mean() * (depth.magnitude.astype(np.float64) ** 2).sum())  # fmt: skip
    return (t_visual.conj() * t_depth).sum().real / np.sqrt((np.abs(t_visual) ** 2).sum() * energy)


@pytest.mark.parametrize("view", [window(20, 40), window(64, 84), window(5, 70)])
def test_it_is_the_cosine_between_doubled_gradients_in_view(view):
    ranges = rooms(np.full(WIDTH, 6.0), NUM_CELLS, 9)
    depths = [depth_features(panorama, ComparisonParams()) for panorama in ranges[:6]]
    visual = part_of(ranges[9], 4, view)
    found = correlate_part(visual, stack_features(depths), NUM_HEADINGS, np.array([1, 5]))
    wanted = [[defined(visual, depths[cell], heading) for heading in range(NUM_HEADINGS)] for cell in (1, 5)]
    np.testing.assert_allclose(found, wanted, atol=0.02)  # bytes: magnitudes to 1 %, directions to 0.4 degrees
    assert np.all(np.abs(found) <= 1.01)


@pytest.mark.parametrize("view", [window(20, 40), window(64, 84)])
def test_place_and_heading_of_a_part_are_found(view):
    ranges = rooms(np.full(WIDTH, 6.0), NUM_CELLS, 9)
    stack = depth_features_many(ranges, ComparisonParams())
    for cell, heading in ((7, 0), (12, 5), (50, 31)):
        found = correlate_part(part_of(ranges[cell], heading, view), stack, NUM_HEADINGS, np.arange(NUM_CELLS))
        assert np.unravel_index(np.argmax(found), found.shape) == (cell, heading)
        assert found[cell, heading] == pytest.approx(1.0, abs=0.01)


def test_contrast_upside_down_and_in_any_unit_changes_nothing():
    ranges, view = rooms(np.full(WIDTH, 6.0), NUM_CELLS, 9), window(20, 40)
    stack = depth_features_many(ranges[:5], ComparisonParams())
    visual = part_of(ranges[2], 3, view)
    other = GradientFeatures(-visual.x, -visual.y, 7.0 * visual.magnitude, view)
    found = [correlate_part(image, stack, NUM_HEADINGS, np.arange(5)) for image in (visual, other)]
    np.testing.assert_allclose(found[1], found[0], atol=1e-5)


def test_an_image_without_gradients_and_a_map_without_them_correlate_with_nothing():
    ranges, view = rooms(np.full(WIDTH, 6.0), NUM_CELLS, 9)[:3], window(20, 40)
    flat = GradientFeatures(*(np.zeros((HEIGHT, WIDTH), np.float32) for _ in range(3)), view)
    stack = depth_features_many(ranges, ComparisonParams())
    np.testing.assert_array_equal(correlate_part(flat, stack, NUM_HEADINGS, np.arange(3)), 0.0)
    empty = depth_features_many(np.full_like(ranges, 5.0), ComparisonParams())
    np.testing.assert_array_equal(correlate_part(part_of(ranges[0], 0, view), empty, NUM_HEADINGS, np.arange(3)), 0.0)
