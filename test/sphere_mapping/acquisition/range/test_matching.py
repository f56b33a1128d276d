"""Disparity along columns: near surfaces by coarser levels, and nothing where nothing can be known."""

import cv2
import numpy as np
import pytest

from sphere_mapping.acquisition.params import MatchParams
from sphere_mapping.acquisition.range.matching import Search, match_columns

SHAPE = (512, 400)
NOISE = 1.5


def texture(seed, blur=1.5, contrast=40):
    image = cv2.GaussianBlur(np.random.default_rng(seed).normal(0, 1, SHAPE), (0, 0), blur)
    return 128 + contrast * image / image.std()


def match(top, bottom, last_px=150.0, **params):
    rng = np.random.default_rng(9)
    read = [np.clip(image + rng.normal(0, NOISE, SHAPE), 1, 255).astype(np.uint8) for image in (top, bottom)]
    return match_columns(*read, Search(-2.0, last_px), MatchParams(**params), np.ones(SHAPE, np.bool_))


@pytest.mark.parametrize(("shift", "last_px"), [(10, 150.0), (140, 139.0)])
def test_every_disparity_of_the_search_is_found_whichever_level_it_needs(shift, last_px):
    top = texture(0, blur=4.0)
    found = match(top, np.roll(top, -shift, axis=0), last_px)
    inner = found.value[200:-30, 30:-30]
    known = np.isfinite(inner)
    assert known.mean() > 0.5
    assert np.abs(inner[known] - shift).max() < 0.5


def test_a_surface_nearer_than_the_search_is_not_measured():
    top = texture(0, blur=4.0)
    found = match(top, np.roll(top, -130, axis=0), last_px=40.0)
    assert np.isfinite(found.value).mean() < 0.01


def test_a_pattern_that_repeats_within_the_search_is_not_measured():
    rows = 128 + 50 * np.sin(2 * np.pi * np.arange(SHAPE[0]) / 16.0)
    stripes = np.repeat(rows[:, None], SHAPE[1], axis=1)
    found = match(stripes, np.roll(stripes, -8, axis=0))
    assert np.isfinite(found.value[64:]).mean() < 0.01  # above, the other matches would be outside of the image


def test_errors_by_their_deviation_are_of_size_one():
    top = texture(3, contrast=25)
    found = match(top, np.roll(top, -12, axis=0), noise=NOISE, calibration_px=0.0)
    known = np.isfinite(found.value)
    ratio = (found.value[known] - 12) / found.std[known]
    # smoothing makes it better than one block says; the factor on it is that of rooms, where more than noise errs
    assert 0.2 < np.sqrt(np.mean(ratio[np.abs(ratio) < 5] ** 2)) < 1.2
    assert np.mean(np.abs(ratio) > 3) < 0.01


def test_where_a_block_sees_two_surfaces_three_deviations_reach_both():
    top = texture(5, contrast=25)
    shift = np.where(np.arange(SHAPE[1]) < 200, 12, 15)
    bottom = np.where(shift == 12, np.roll(top, -12, axis=0), np.roll(top, -15, axis=0))
    found = match(top, bottom, noise=NOISE, calibration_px=0.0)
    known = np.isfinite(found.value)
    beside = known & (np.abs(np.arange(SHAPE[1]) - 199.5) < 4)
    assert beside.sum() > 500
    assert np.mean((np.abs(found.value - shift) > 3 * found.std)[beside]) < 0.05
    assert np.median(found.std[beside]) > 0.5 > 5 * np.median(found.std[known])
