"""The learned likeness as the filter sees it: one answer by particles and by the survey, bytes."""

from __future__ import annotations

import numpy as np
import pytest

from mcl_depth.constants import CHANCE
from mcl_depth.geometry.synthesis import panorama_window
from mcl_depth.likeness.encoder import load_encoders
from mcl_depth.likeness.learned import LearnedFilter, compare_learned, pack, unpack
from mcl_depth.params import SynthesisParams

WINDOW = panorama_window(SynthesisParams())
NUM_CELLS, NUM_HEADINGS = 60, 36


@pytest.fixture(scope="module")
def encoders():
    return load_encoders()


@pytest.fixture(scope="module")
def features(encoders):
    """Features of cells before walls with pillars of their own."""
    rng = np.random.default_rng(6)
    ranges = np.full((NUM_CELLS, WINDOW.height, WINDOW.width), 5.0, np.float32)
    for panorama in ranges:
        for _ in range(6):
            u, v, width = rng.integers(WINDOW.width), rng.integers(WINDOW.height - 12), rng.integers(4, 20)
            panorama[v : v + 12, (u + np.arange(width)) % WINDOW.width] = rng.uniform(1.0, 3.0)
    return encoders.features_of_depths(ranges, WINDOW)


def test_place_and_heading_are_found_by_particles_and_by_the_survey(features):
    stack = pack(features)
    survey = LearnedFilter.of(stack, np.arange(NUM_CELLS))
    for cell, columns in ((7, 0), (33, 25), (59, 80)):
        seen = np.roll(features[cell], columns, axis=-1)
        heading = columns * 4 // 10
        curves = survey.curves(seen, NUM_HEADINGS)
        assert np.unravel_index(np.argmax(curves), curves.shape) == (cell, heading)
        by_particles = compare_learned(seen, stack, np.arange(NUM_CELLS), NUM_HEADINGS)
        assert np.unravel_index(np.argmax(by_particles), by_particles.shape) == (cell, heading)
        np.testing.assert_allclose(by_particles.mean(axis=1), CHANCE, atol=1e-5)
        assert np.all(by_particles < CHANCE + 1.0)
        rows = np.array([cell, 3])
        np.testing.assert_allclose(survey.curves(seen, NUM_HEADINGS, rows), survey.curves(seen, NUM_HEADINGS)[rows])


def test_the_survey_is_the_circular_correlation_of_the_features(features):
    survey = LearnedFilter.of(pack(features), np.arange(NUM_CELLS))
    found = survey.curves(features[5], NUM_HEADINGS) / features.shape[-1]
    columns = features.shape[-1]
    shifted = np.stack([np.roll(features[5], shift, axis=-1) for shift in range(columns)])
    wanted = np.einsum("scyx,ncyx->ns", shifted, features)
    for heading in (0, 4, 12, 18):  # a whole number of columns
        at = -heading * columns // NUM_HEADINGS  # an image that is turned back so far
        assert np.all(found[:, heading] > wanted[:, at] - 0.05)  # what bytes lose; the best around a heading
    assert found[5, 0] == pytest.approx(1.0, abs=0.05)  # bytes cut what exceeds four standard deviations
    assert np.corrcoef(found[:, 12], wanted[:, -30])[0, 1] > 0.8 > np.corrcoef(found[:, 12], wanted[:, 30])[0, 1]


def test_bytes_keep_the_features(features):
    stack = pack(features)
    assert np.abs(unpack(stack) - features).max() <= 0.51 * stack["scale"].max()
