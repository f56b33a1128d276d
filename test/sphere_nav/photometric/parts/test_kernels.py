"""Scores of shifts, against the definition."""

import numpy as np

from sphere_nav.photometric.parts.kernels import score_shifts


def test_a_score_is_the_weighted_sum_of_cosines_of_its_cell_at_each_shift(rng):
    image, reach = rng.integers(0, 255, (30, 40)).astype(np.float32), 2
    image[10, 10] = np.nan  # not seen
    column, row = rng.integers(3, 37, 50).astype(np.int32), rng.integers(3, 27, 50).astype(np.int32)
    angle, weight = rng.uniform(-np.pi, np.pi, 50), rng.uniform(1.0, 2.0, 50).astype(np.float32)
    direction = np.column_stack([np.cos(angle), np.sin(angle)]).astype(np.float32)
    cell = rng.integers(0, 3, 50).astype(np.int32)
    scores = np.zeros((3, 5, 5))
    score_shifts(image, column, row, direction, weight, cell, reach, scores)
    down, right = np.gradient(image)
    expected = np.zeros((3, 5, 5))
    for i, j in np.ndindex(5, 5):
        y, x = row + i - reach, column + j - reach
        gradient = np.column_stack([right[y, x], down[y, x]])
        cosine = np.sum(gradient * direction, axis=1) / np.linalg.norm(gradient, axis=1)
        np.add.at(expected[:, i, j], cell, np.nan_to_num(weight * cosine))
    np.testing.assert_allclose(scores, expected, atol=1e-4)
