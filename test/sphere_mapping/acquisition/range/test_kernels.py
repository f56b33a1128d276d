"""Volumes of costs over hypotheses: summed as NumPy sums them, smoothed along paths, judged."""

import numpy as np
import pytest

from sphere_mapping.acquisition.range import kernels

K = kernels.NUM_HYPOTHESES


def test_blocks_are_summed_as_numpy_does():
    cost = np.random.default_rng(3).integers(0, kernels.COST_CAP, (17, 22, K)).astype(np.uint8)
    for side in (5, 9):
        found = np.empty((18 - side, 23 - side, K), np.int16)
        kernels.sum_blocks(cost, side // 2, found)
        expected = np.lib.stride_tricks.sliding_window_view(cost.astype(int), (side, side), (0, 1)).sum(axis=(-1, -2))
        np.testing.assert_array_equal(found, expected)


def test_paths_carry_a_hypothesis_to_where_nothing_is_told():
    cost = np.full((12, 48, K), 900, np.int16)
    cost[:, :, 20] = 100
    cost[4:8, 20:28] = 900  # bare
    total = np.zeros_like(cost)
    kernels.sum_paths(cost, np.int16(60), np.int16(600), total)
    assert (np.argmin(total, axis=2) == 20).all()
    assert total.max() < np.iinfo(np.int16).max


def judge(smoothed, block):
    found = np.empty((1, 1), np.float32)
    limits = np.array([486.0, 1.2], np.float32)
    kernels.choose(smoothed.reshape(1, 1, K), block.reshape(1, 1, K), *limits, found)
    return found[0, 0]


def test_only_a_hypothesis_that_is_clearly_the_best_is_chosen():
    k = np.arange(K)
    clear = np.minimum(200 + 100 * (k - 30.25) ** 2, 9000).astype(np.int16)
    assert judge(clear, clear) == pytest.approx(30.25, abs=0.01)
    assert np.isnan(judge(clear, np.full(K, 5000, np.int16)))  # smoothness alone
    repeated = np.minimum(clear, np.roll(clear, 12))
    assert np.isnan(judge(clear, repeated))
    assert np.isnan(judge(np.roll(clear, K - 31), np.roll(clear, K - 31)))  # beyond the nearest one nothing is compared
    assert judge(np.roll(clear, -30), np.roll(clear, -30)) == 0.0
