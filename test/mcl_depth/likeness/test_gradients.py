"""The filter is the correlation of gradients, of what is seen."""

from __future__ import annotations

import numpy as np
import pytest

from mcl_depth.likeness.features import GradientFeatures
from mcl_depth.likeness.gradients import Gradients
from mcl_depth.params import ComparisonParams
from worlds.panoramas import HEIGHT, NUM_HEADINGS, WIDTH, part_of, rooms, square_room, window

MIN_VIEW_SHARE = 0.1

NUM_CELLS = 300
LIKENESS = Gradients(ComparisonParams())


@pytest.fixture(scope="module")
def ranges():
    return rooms(square_room(), NUM_CELLS, 9)


@pytest.fixture(scope="module")
def stack(ranges):
    return LIKENESS.depths(ranges)


def correlation(visual, stack):
    shifts = np.arange(NUM_HEADINGS) * WIDTH // NUM_HEADINGS
    x, y, m = visual.x.astype(np.float64), visual.y, visual.magnitude
    seen, image = visual.is_seen, m * (x + 1j * y) ** 2
    columns = (np.arange(WIDTH) + shifts[:, None]) % WIDTH
    images, views = (a[:, columns].transpose(1, 0, 2).reshape(NUM_HEADINGS, -1) for a in (image, seen))
    depths = np.stack([m * (x + 1j * y) ** 2 for x, y, m in decoded(stack)]).reshape(NUM_CELLS, -1)
    squares = np.abs(depths) ** 2
    least = MIN_VIEW_SHARE * seen.mean() * squares.sum(axis=1, keepdims=True)
    lengths = np.sqrt(np.maximum(squares @ views.T, least) * np.sum(np.abs(image) ** 2))
    return (depths @ images.conj().T).real / lengths


def survey(visual, stack, slots=None):
    return LIKENESS.survey(visual, stack, np.arange(NUM_CELLS) if slots is None else slots, NUM_HEADINGS)


def test_a_part_is_found_as_by_the_correlation_where_a_strong_edge_weighs_by_its_root(ranges, stack):
    for cell, heading in ((7, 0), (120, 5), (299, 31)):
        found = survey(part_of(ranges[cell], heading, window(64, 84)), stack)
        assert np.unravel_index(np.argmax(found), found.shape) == (cell, heading)
    visual = part_of(ranges[9], 4, window(20, 46))
    rooted = GradientFeatures(visual.x, visual.y, np.sqrt(visual.magnitude), visual.is_seen)
    found = survey(visual, stack)
    wanted = correlation(rooted, stack)
    likeness = [np.corrcoef(found.ravel(), c.ravel())[0, 1] for c in (wanted, correlation(visual, stack))]
    assert likeness[0] > max(likeness[1], 0.95)  # the best around each heading, in bytes
    dark = GradientFeatures(visual.x, visual.y, visual.magnitude * 1e-3, visual.is_seen)
    np.testing.assert_allclose(survey(dark, stack), found, rtol=1e-3, atol=1e-6)
    other = GradientFeatures(-visual.x, -visual.y, visual.magnitude, visual.is_seen)  # contrast upside down
    np.testing.assert_allclose(survey(other, stack), found, rtol=1e-3, atol=1e-6)


def decoded(stack):
    angles = stack["directions"] * np.pi / 255
    known = stack["directions"] < 255
    magnitudes = stack["scale"][:, None, None] * (stack["magnitudes"] / 255.0) ** 2
    return zip(np.cos(angles) * known, np.sin(angles) * known, magnitudes, strict=True)


def test_cells_without_ground_and_images_without_gradients_fit_nothing(stack, ranges):
    slots = np.arange(NUM_CELLS)
    slots[4] = -1
    view = window(20, 40)
    curves = survey(part_of(ranges[9], 0, view), stack, slots)
    np.testing.assert_array_equal(curves[4], 0.0)
    assert np.argmax(curves.max(axis=1)) == 9
    flat = GradientFeatures(*(np.zeros((HEIGHT, WIDTH), np.float32) for _ in range(3)), view)
    np.testing.assert_array_equal(survey(flat, stack), 0.0)
