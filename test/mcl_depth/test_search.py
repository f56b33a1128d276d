"""What makes a search from nowhere robust: copies fill the gaps between particles, chance counts nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mcl_depth.belief.particles import Particles
from mcl_depth.belief.resampling import compute_weights, resample, scale_similarities
from mcl_depth.constants import CHANCE

# Written out: imported, a change would go unseen.
ROUGHENING = 0.3


def lonely(age):
    """Particles of which one carries the belief."""
    poses = np.column_stack([np.arange(1000.0), np.zeros(1000), np.full(1000, 0.4)])
    return replace(Particles.of_equal_weight(poses, age), weights=np.eye(1000)[7])


def test_copies_of_a_young_particle_fill_the_gap_to_its_neighbours():
    found = resample(lonely(1), 1000, np.random.default_rng(1), gap=2.0).poses
    np.testing.assert_allclose(found[:, :2].mean(axis=0), [7.0, 0.0], atol=0.14)  # four standard errors
    np.testing.assert_allclose(found[:, :2].std(axis=0), 2.0 * ROUGHENING, rtol=0.16)  # four standard errors
    np.testing.assert_array_equal(found[:, 2], 0.4)


def test_copies_of_an_old_particle_stay_where_it_was():
    found = resample(lonely(3), 1000, np.random.default_rng(1), gap=2.0).poses
    np.testing.assert_array_equal(found, np.tile([7.0, 0.0, 0.4], (len(found), 1)))


def test_chance_is_what_unrelated_gradients_give():
    rng = np.random.default_rng(2)
    angles = rng.uniform(0.0, np.pi, (2, 200_000))
    share = np.full(200_000, 1.0 / 200_000)
    similarity = np.sum(np.abs(np.cos(angles[0] - angles[1])) * (share + share))  # eq. 2, both magnitudes sum to 1
    assert similarity == pytest.approx(CHANCE, abs=0.005)  # five standard errors


def test_what_is_not_better_than_chance_has_no_weight():
    s = np.array([CHANCE - 0.1, CHANCE, CHANCE + 0.05, CHANCE + 0.1])
    np.testing.assert_allclose(scale_similarities(s), [0.0, 0.0, 0.5, 1.0])
    found = compute_weights(s, np.full(4, 0.25), exponent=2.0, min_effective_share=0.0)
    np.testing.assert_allclose(found, [0.0, 0.0, 0.2, 0.8], atol=1e-12)


def test_what_has_left_the_map_dies_however_little_one_image_may_decide():
    s = np.array([0.0, 0.0, 0.0, 1.40, 1.41])
    found = compute_weights(s, np.full(5, 0.2), min_effective_share=0.8)
    np.testing.assert_array_equal(found[:3], 0.0)
    assert 1.0 / np.sum(found**2) > 0.8 * 2  # of the two that are left
