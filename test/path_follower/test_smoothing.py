"""Curves through points: circles stay circles, noise goes, corners and coarse points are treated as such."""

import math

import numpy as np
import pytest

from path_follower.params import PathParams
from path_follower.smoothing import cutoff_weight, smooth_curve

# Written out: imported, a change would go unseen.
MIN_SPACING, SPACING = 0.2, 0.1

PARAMS = PathParams()


def circle(radius, turn, spacing):
    angle = np.arange(0.0, turn, spacing / radius)
    return radius * np.stack([np.sin(angle), 1 - np.cos(angle)], axis=-1)


def test_a_circle_keeps_its_radius():
    for spacing in [0.02, 0.1, 1.0]:
        for radius in [3.0, 10.0]:
            curve = smooth_curve(circle(radius, 5.0, spacing), PARAMS, is_closed=False)
            inner = slice(20, -20)  # the ends know one side only
            np.testing.assert_allclose(curve.bend[inner], 1 / radius, rtol=0.01)
            # Averages over the 0.2 m of a bin lie inside by 0.2^2 / 24 / radius at most.
            np.testing.assert_allclose(np.hypot(curve.x, curve.y - radius), radius, atol=0.003)
            assert np.ptp(np.diff(curve.way)) < 0.02 * SPACING
            assert np.diff(curve.way).mean() == pytest.approx(0.1, rel=0.02)


def test_noise_of_two_centimeters_does_not_reach_the_curvature():
    clean = np.stack([np.arange(0, 30, 0.05), np.zeros(600)], axis=-1)
    noisy = clean + np.random.default_rng(0).normal(0, 0.02, clean.shape)
    curve = smooth_curve(noisy, PARAMS, is_closed=False)
    assert np.sqrt(np.mean(curve.y**2)) < 0.01
    assert np.sqrt(np.mean(curve.bend[10:-10] ** 2)) < 0.03  # a wheel moved by two degrees
    assert curve.way[-1] == pytest.approx(30.0, abs=0.1)  # zigzags would lengthen it


def test_the_filter_halves_bends_of_the_smoothing_length():
    for wavelength, gain in [(2.0, 0.5), (20.0, 1.0), (0.7, 0.0)]:
        x = np.arange(0, 60, MIN_SPACING + 1e-9)  # wide enough not to be averaged
        wave = 1e-3 * np.sin(2 * np.pi * x / wavelength)
        curve = smooth_curve(np.stack([x, wave], axis=-1), PARAMS, is_closed=False)
        inner = (curve.x > 10) & (curve.x < 50)
        found = np.sqrt(2) * np.std(curve.y[inner]) / 1e-3
        assert found == pytest.approx(gain, abs=0.03)


def test_the_filter_is_independent_of_the_spacing():
    # For wavelengths far above the spacing the weight grows as its inverse sixth power.
    assert cutoff_weight(4.0, 0.05) / cutoff_weight(4.0, 0.1) == pytest.approx(2**6, rel=0.02)


def test_a_ring_closes_without_a_seam():
    ring = circle(8.0, 2 * math.pi, 0.3)
    curve = smooth_curve(ring, PARAMS, is_closed=True)
    assert (curve.x[0], curve.y[0]) == (pytest.approx(curve.x[-1]), pytest.approx(curve.y[-1]))
    assert curve.bend[0] == pytest.approx(curve.bend[-1])
    np.testing.assert_allclose(curve.bend, 1 / 8, rtol=0.01)
    assert curve.tangent[-1] - curve.tangent[0] == pytest.approx(2 * math.pi, abs=1e-6)


def test_points_of_a_curve_are_joined_by_a_curve_and_corners_by_straight_lines():
    for bend, is_curve in [(0.5, True), (0.7, False)]:
        angles = bend * np.arange(5)
        points = 5.0 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        curve = smooth_curve(points, PathParams(smoothing_length=0.0), is_closed=False)
        lowest = np.hypot(curve.x, curve.y).min()
        assert lowest == pytest.approx(5.0 if is_curve else 5.0 * np.cos(bend / 2), abs=0.03)


def test_a_corner_is_rounded_and_not_swung_around():
    curve = smooth_curve(np.array([[0, 0], [10, 0], [10, 10.0]]), PARAMS, is_closed=False)
    assert curve.x.max() < 10.15
    assert curve.y.min() > -0.15
    assert curve.bend.max() * 3 > math.pi / 2 / 2  # it turns within a few metres


def test_few_points_are_enough():
    for points in [[[0, 0], [1, 0]], [[0, 0], [0.3, 0]], [[0, 0], [1, 0], [2, 0.1]]]:
        curve = smooth_curve(np.array(points, dtype=float), PARAMS, is_closed=False)
        assert np.isfinite(np.stack(curve)).all()
        assert curve.way[-1] == pytest.approx(np.hypot(*np.diff(points, axis=0).T).sum(), rel=0.02)
