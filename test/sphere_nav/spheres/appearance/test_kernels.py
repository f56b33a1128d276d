"""Scores of turns, against the definition."""

import numpy as np

from sphere_nav.spheres.appearance.kernels import score_turns


def test_a_score_is_the_sum_of_products_of_its_cell_at_each_turn_and_rise(rng):
    height, width, number, reach = 7, 12, 40, 2
    directions = rng.normal(size=(2, height, width)).astype(np.float32)
    row, column = rng.integers(0, height, number), rng.integers(0, width, number)
    direction, cell = rng.normal(size=(number, 2)).astype(np.float32), rng.integers(0, 3, number)
    scores = np.zeros((3, 2 * reach + 1, width), np.float32)
    places = row.astype(np.int32), column.astype(np.int32)
    score_turns(*places, direction, cell.astype(np.int32), reach, directions, scores)
    expected = np.zeros(scores.shape)
    for rise in range(-reach, reach + 1):
        for turn in range(width):
            y = row + rise
            there = directions[:, y.clip(0, height - 1), (column + turn) % width] * ((y >= 0) & (y < height))
            np.add.at(expected[:, rise + reach, turn], cell, np.sum(there.T * direction, axis=1))
    np.testing.assert_allclose(scores, expected, atol=1e-4)
