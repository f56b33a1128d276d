"""Resampling, weights, headings, motion, hypotheses, cache and homing against what they should be in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from mcl_depth.belief.hypotheses import find_hypotheses
from mcl_depth.belief.motion_model import MotionModel, compose_planar, relative_motion
from mcl_depth.belief.particles import Particles, best_headings, interpolate_similarity
from mcl_depth.belief.resampling import compute_weights, low_variance_indices, required_particles, resample
from mcl_depth.constants import CHANCE
from mcl_depth.homing import Homing, sample_offsets, waypoints_of
from mcl_depth.likeness.depth_cache import DepthCache
from mcl_depth.likeness.features import FeatureStack
from mcl_depth.params import DirectionParams, MotionParams
from sphere_nav.geometry import SE3

# Written out: imported, a change would go unseen.
MIN_PARTICLES = 300


def test_the_low_variance_sampler_takes_floor_or_ceil_of_each_share():
    rng = np.random.default_rng(3)
    shares = rng.dirichlet(np.ones(20))
    for start in (0.0, 0.4, 0.99):
        counts = np.bincount(low_variance_indices(shares, 500, start), minlength=20)
        assert np.all(np.abs(counts - 500 * shares) < 1.0)
        assert counts.sum() == 500


def test_more_bins_need_more_particles_within_the_bounds():
    counts = [required_particles(bins, 1000) for bins in (1, 10, 40, 10_000)]
    assert counts == sorted(counts)
    assert counts[0] == MIN_PARTICLES
    assert counts[-1] == 1000


def test_particles_that_all_count_are_not_resampled():
    particles = Particles.of_equal_weight(np.zeros((50, 3)))
    assert resample(particles, 50, np.random.default_rng(0)) is particles


def test_weights_follow_the_power_law_above_chance():
    s, prior = CHANCE + np.array([0.1, 0.2, 0.4]), np.full(3, 1 / 3)
    found = compute_weights(s, prior, exponent=2.0, min_effective_share=0.0)
    np.testing.assert_allclose(found, np.array([1, 4, 16]) / 21)


def test_lambda_is_lowered_until_enough_particles_survive():
    s, prior = CHANCE + np.linspace(0.05, 0.1, 100), np.full(100, 0.01)
    sharp = compute_weights(s, prior, min_effective_share=0.0)
    soft = compute_weights(s, prior, min_effective_share=0.5)
    assert 1 / np.sum(sharp**2) < 50
    assert 1 / np.sum(soft**2) == pytest.approx(50, rel=1e-3)


def test_the_heading_of_a_parabola_is_found_between_the_steps():
    true = np.radians([13.0, -171.0, 58.5])
    grid = np.arange(36) * np.radians(10)
    curves = np.cos(grid - true[:, None])
    np.testing.assert_allclose(best_headings(curves), true, atol=np.radians(0.1))
    np.testing.assert_allclose(interpolate_similarity(curves, grid[[3, 7, 35]]), np.diag(curves[:, [3, 7, 35]]))


def test_between_undoes_moved():
    before, motion = np.array([1.0, -2.0, 2.5]), np.array([0.7, 0.1, 0.9])
    np.testing.assert_allclose(relative_motion(before, compose_planar(before[None], motion)[0]), motion, atol=1e-12)


def test_leaping_and_missing_odometry_leave_the_motion_unknown():
    model = MotionModel(MotionParams())
    model.step(10**9, SE3.identity())
    assert model.step(2 * 10**9, SE3.from_planar(1.0, 0.0, 0.0)).is_known
    leap = model.step(3 * 10**9, SE3.from_planar(80.0, 0.0, 0.0))
    assert (leap.is_known, leap.jump) == (False, pytest.approx(79.0))
    assert not model.step(4 * 10**9, None).is_known


def test_two_heaps_of_particles_are_two_hypotheses():
    rng = np.random.default_rng(5)
    heaps = [rng.normal((x, 0.0, yaw), 0.05, (n, 3)) for x, yaw, n in ((0.0, 3.1, 60), (8.0, 0.0, 40))]
    found = find_hypotheses(Particles.of_equal_weight(np.concatenate(heaps)))
    assert [item.weight for item in found] == pytest.approx([0.6, 0.4])
    np.testing.assert_allclose(found[1].pose, [8.0, 0.0, 0.0], atol=0.05)
    assert found[0].sigma_rad < 0.1  # the heap sits on the cut at pi


def empty(count):
    return FeatureStack.empty(count, 4, 8)


def features(value, count=1):
    stack = empty(count)
    stack.directions[:], stack.magnitudes[:], stack.scales[:] = value, value, value
    return stack


def test_the_cache_gives_away_what_was_not_used_for_longest_and_survives_on_disk(tmp_path):
    cache = DepthCache(3 * features(0).nbytes, empty)
    for number in range(3):
        cache.insert([(number, 0)], features(number))
    cache.find([(0, 0)])
    cache.insert([(9, 9)], features(9))
    assert (1, 0) not in cache
    assert cache.stack.scales[cache.find([(0, 0)])[0]] == 0.0
    cache.save(tmp_path / "kept")
    again = DepthCache(3 * features(0).nbytes, empty)
    assert again.load(tmp_path / "kept") == 3
    assert again.stack.scales[again.find([(9, 9)])[0]] == 9.0


def test_a_damaged_cache_is_refused_in_one_line(tmp_path):
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept" / "cells.npy").write_bytes(b"nothing")
    with pytest.raises(ValueError, match="expected a cache of depth features"):
        DepthCache(1 << 20, empty).load(tmp_path / "kept")


def test_homing_samples_are_those_of_the_paper():
    ring = sample_offsets(1.0)
    assert ring.shape == (33, 2)  # 16 directions at 1 m and 2 m, and the waypoint itself
    np.testing.assert_allclose(np.linalg.norm(ring, axis=1), [0.0] + [1.0] * 16 + [2.0] * 16)


@pytest.mark.parametrize(("num_best", "lead", "is_clear"), [(10, 1.517, True), (11, 1.414, False)])
def test_a_direction_is_clear_where_the_best_samples_lead_by_one_and_a_half_deviations(num_best, lead, is_clear):
    """Of 33 samples `num_best` fit equally well, the others not at all: a lead of sqrt((1 - p) / p), p their share."""
    like = np.zeros((33, 8), np.float32)
    like[:num_best, 3] = 1.0
    advice = Homing(np.array([[0.0, 0.0], [9.0, 0.0]]), DirectionParams()).update(Curves(like))
    assert advice.lead == pytest.approx(lead, abs=1e-3)
    assert advice.is_clear == is_clear


class Curves:
    """A comparison whose similarities (N, A) are given."""

    def __init__(self, values):
        self.values = values

    def curves(self, positions):
        assert len(positions) == len(self.values)
        return self.values


def test_waypoints_are_evenly_spaced_and_a_path_needs_two_points():
    points = waypoints_of(np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 3.0]]), 1.5)
    np.testing.assert_allclose(points, [[0, 0], [1.5, 0], [3, 0], [3, 1.5], [3, 3]])
    with pytest.raises(ValueError, match="at least two"):
        waypoints_of(np.zeros((1, 2)), 1.0)


@pytest.mark.parametrize("name", ["directions", "magnitudes", "scales"])
def test_a_cache_of_another_size_is_refused_whatever_array_it_is(tmp_path, name):
    cache = DepthCache(3 * features(0).nbytes, empty)
    cache.insert([(1, 2), (3, 4)], features(1, 2))
    cache.save(tmp_path / "kept")
    found = np.load(tmp_path / "kept" / f"{name}.npy")
    np.save(tmp_path / "kept" / f"{name}.npy", found[:, :3] if found.ndim == 3 else found[:1])
    with pytest.raises(ValueError, match=r"kept: expected features \[\(2, 4, 8\)"):
        DepthCache(1 << 20, empty).load(tmp_path / "kept")


def test_a_smaller_cache_takes_what_was_used_last_and_counts_its_hits(tmp_path):
    cache = DepthCache(4 * features(0).nbytes, empty)
    for number in range(4):
        cache.insert([(number, -number)], features(number))
    cache.find([(0, 0)])
    cache.save(tmp_path / "kept")
    small = DepthCache(2 * features(0).nbytes + 5, empty)
    assert small.load(tmp_path / "kept") == 2
    slots = small.find([(3, -3), (0, 0), (2, -2), (1, -1)])
    assert (slots >= 0).tolist() == [True, True, False, False]
    assert small.stack.scales[slots[:2]].tolist() == [3.0, 0.0]
    assert small.hit_rate == 0.5
    small.clear()
    assert (small.hit_rate, len(small), DepthCache(1, empty).capacity) == (0.0, 0, 1)
    assert small.load(tmp_path / "none") == 0
