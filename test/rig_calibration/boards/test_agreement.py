"""Disagreement of a camera with itself is a matter of its deviations."""

from types import SimpleNamespace

import numpy as np
import pytest

from rig_calibration.boards.checks import disagreements, lens_chance

COVARIANCE = np.diag([0.04, 0.04, 0.01, 0.01, *[0.0] * 8])  # the distortion is held


def single(num_views=20, rms_px=0.2):
    lens = np.array([300.0, 300.0, 320.0, 240.0, *[0.0] * 8])
    return SimpleNamespace(lens=lens, lens_covariance=COVARIANCE, rms_px=rms_px, num_views=num_views)


def test_the_chance_of_a_change_is_that_of_its_deviations(rng):
    own = single()
    changes = rng.multivariate_normal(np.zeros(12), COVARIANCE, 2000)
    chances = np.array([lens_chance(own, own.lens + change) for change in changes])
    for level in (0.01, 0.1, 0.5):
        assert np.mean(chances < level) == pytest.approx(level, abs=4 * np.sqrt(level * (1 - level) / 2000))


def test_lenses_and_residuals_that_change_are_told():
    own = single()
    moved = own.lens + np.array([2.0, *[0.0] * 11])
    lines = disagreements(["a", "b"], [own, own], np.stack([own.lens, moved]), np.array([0.2, 0.2]))
    assert lines[0].startswith("b: by itself and with the others it is not the same camera: fx moved by +2.00 px")
    lines = disagreements(["a", "b"], [own, own], np.stack([own.lens] * 2), np.array([0.4, 0.2]))
    assert lines[0].startswith("a: ")
    assert "residuals of 0.40 px in place of 0.20" in lines[0]


def test_what_agrees_and_what_is_alone_says_nothing():
    own = single()
    assert disagreements(["a", "b"], [own, own], np.stack([own.lens] * 2), np.array([0.2, 0.21])) == []
    assert disagreements(["a"], [own], own.lens[None] + 5.0, np.array([2.0])) == []
