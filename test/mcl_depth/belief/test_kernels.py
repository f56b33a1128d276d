"""How the joint evidence moves and where it is highest, against the same written otherwise."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter

from mcl_depth.belief.evidence import find_maxima
from mcl_depth.belief.joint_evidence import relax, shift_headings


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
