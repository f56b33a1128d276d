"""Which cells of a map are compared; how the joint evidence moves and where it is highest, written otherwise."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.ndimage import maximum_filter

from mcl_depth.belief.evidence import find_maxima
from mcl_depth.belief.joint_evidence import SurveyGrid, relax, shift_headings

EDGE = 0.5


def field_of(seed):
    return np.random.default_rng(seed).normal(size=(12, 9, 7)).astype(np.float32)


def test_headings_are_shifted_each_by_its_own_way():
    field = field_of(1)
    shifts = np.random.default_rng(2).integers(-9, 10, (12, 2))
    out = shift_headings(field, shifts, 5)
    for a, (dx, dy) in enumerate(shifts):
        padded = np.pad(field[a], 10, constant_values=0.0)
        np.testing.assert_array_equal(out[(a + 5) % 12], padded[10 - dx : 19 - dx, 10 - dy : 17 - dy])


def test_the_best_neighbour_counts_less_its_cost():
    field = 5.0 * field_of(3)
    turned = np.maximum(field, np.maximum(np.roll(field, 1, axis=0), np.roll(field, -1, axis=0)) - 2.5)
    cross = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]], bool)[None]
    beside = maximum_filter(turned, footprint=cross, mode="constant", cval=-np.inf)
    np.testing.assert_allclose(relax(field), np.maximum(turned, beside - 2.5), atol=1e-6)


def test_maxima_exceed_all_within_two_cells_and_headings_of_the_map():
    field, mask = field_of(4), np.random.default_rng(5).random((9, 7)) < 0.8
    places, values = find_maxima(field, mask)
    np.testing.assert_allclose(values, field[tuple(places.T)])
    assert values[0] == field[:, mask].max()
    assert np.all(np.diff(values) <= 0.0)
    for a, x, y in places:
        around = np.roll(field, 2 - a, axis=0)[:5, max(x - 2, 0) : x + 3, max(y - 2, 0) : y + 3]
        near = mask[max(x - 2, 0) : x + 3, max(y - 2, 0) : y + 3]
        assert mask[x, y]
        assert around[:, near].max() == field[a, x, y]


def depth_map(capacity=10**6):
    def cells(places):
        return np.floor(np.asarray(places) / EDGE).astype(np.int64)

    return SimpleNamespace(edge=EDGE, cells=cells, cache=SimpleNamespace(capacity=capacity))


def l_shape():
    """Middles of cells of an L around the origin: 12 x 4 and 3 x 8 cells."""
    cells = {(x, y) for x in range(-4, 8) for y in range(-3, 1)} | {(x, y) for x in range(-4, -1) for y in range(8)}
    return (np.array(sorted(cells)) + 0.5) * EDGE


def test_no_more_cells_than_four_fifths_of_the_cache():
    for spare, is_coarser in [(0, False), (-1, True), (-60, True)]:
        middles = l_shape()
        capacity = int(np.ceil(len(middles) / 0.8)) + spare
        grid = SurveyGrid(depth_map(capacity), middles)
        assert (grid.edge > EDGE) == is_coarser
        assert len(grid.positions) <= 0.8 * capacity
        off = np.min(np.linalg.norm(middles[None] - grid.positions[:, None], axis=2), axis=1)
        assert off.max() < 1e-9  # what is compared is a cell of the map
        assert grid.diagonal == pytest.approx(np.sqrt(2) * EDGE)
