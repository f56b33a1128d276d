"""Twins of the kernels of the joint evidence in plain NumPy and SciPy."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter

from mcl_depth.belief.joint_evidence import relax
from mcl_depth.belief.kernels import is_maximum, shift_headings


def field_of(seed, shape=(12, 9, 7)):
    return np.random.default_rng(seed).normal(size=shape).astype(np.float32)


def test_headings_are_shifted_each_by_its_own_way():
    field, out = field_of(1), np.empty((12, 9, 7), np.float32)
    shifts = np.random.default_rng(2).integers(-9, 10, (12, 2))
    shift_headings(field, shifts, 5, np.float32(-3.0), out)
    for a, (dx, dy) in enumerate(shifts):
        padded = np.pad(field[a], 10, constant_values=-3.0)
        np.testing.assert_array_equal(out[(a + 5) % 12], padded[10 - dx : 19 - dx, 10 - dy : 17 - dy])


def test_the_best_neighbour_counts_less_its_cost():
    field = 5.0 * field_of(3)
    turned = np.maximum(field, np.maximum(np.roll(field, 1, axis=0), np.roll(field, -1, axis=0)) - 2.5)
    cross = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]], bool)[None]
    beside = maximum_filter(turned, footprint=cross, mode="constant", cval=-np.inf)
    np.testing.assert_allclose(relax(field), np.maximum(turned, beside - 2.5), atol=1e-6)


def test_maxima_are_those_of_a_maximum_filter_and_of_equal_ones_the_first_counts():
    field, mask = field_of(4), np.random.default_rng(5).random((9, 7)) < 0.8
    inside = np.where(mask, field, -np.inf)
    top = maximum_filter(inside, (3, 5, 5), mode=("wrap", "constant", "constant"), cval=-np.inf)
    np.testing.assert_array_equal(is_maximum(field, mask, 1, 2), (inside == top) & mask)
    found = np.argwhere(is_maximum(np.zeros((12, 5, 5), np.float32), np.ones((5, 5), np.bool_), 12, 5))
    np.testing.assert_array_equal(found, [[0, 0, 0]])
