"""Matches of one level: clear ones only, and no seam in a whole sphere."""

import cv2
import numpy as np
import pytest

from sphere_mapping.acquisition.range.semi_global import check_order, find_clear_matches, match_semi_globally

WIDTH, HEIGHT, SHIFT = 384, 192, 9


def pair():
    noise = np.random.default_rng(0).normal(0, 1, (HEIGHT, 3 * WIDTH))
    noise = np.tile(noise[:, :WIDTH], (1, 3))
    smooth = cv2.GaussianBlur(noise, (0, 0), 1.5)[:, WIDTH : 2 * WIDTH]
    top = np.clip(128 + 40 * smooth / smooth.std(), 1, 255).astype(np.uint8)
    return top, np.roll(top, -SHIFT, axis=0)


def test_smoothness_carries_matches_into_a_bare_wall_where_nothing_is_clear():
    top, bottom = pair()
    top[:, 150:230], bottom[:, 150:230] = 120, 120
    inner = np.s_[60:-20, 160:220]
    assert np.isnan(find_clear_matches(top, bottom, -2, is_whole=True)[inner]).all()
    assert np.isfinite(match_semi_globally(top, bottom, -2, is_whole=True)[40:-20, :140]).mean() > 0.9


def test_ground_before_a_pair_does_not_lag_behind_its_slant():
    noise = np.random.default_rng(1).normal(0, 1, (240, 480))
    smooth = cv2.GaussianBlur(noise, (0, 0), 1.5)
    right = np.clip(128 + 40 * smooth / smooth.std(), 1, 255).astype(np.float32)
    rows, columns = np.mgrid[:240, :480].astype(np.float32)
    slant = 4.0 + 0.2 * rows  # px: nearer from row to row
    left = cv2.remap(right, columns - slant, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    top, bottom = (np.ascontiguousarray(np.rint(image).clip(0, 255).astype(np.uint8).T) for image in (left, right))
    found = match_semi_globally(top, bottom, -2, is_whole=False).T
    error = (found - slant)[20:-20, 80:-20]
    assert np.isfinite(error).mean() > 0.975  # 0.974 were it 10 % that the best must be better by
    assert abs(np.nanmedian(error)) < 0.1  # by passes down the rows alone it lags by half a pixel


NAMES = ("top", "bottom")


def texture(seed):
    image = cv2.GaussianBlur(np.random.default_rng(seed).normal(0, 1, (200, 320)), (0, 0), 1.2)
    return np.clip(128 + 40 * image / image.std(), 1, 255).astype(np.uint8)


def test_exchanged_images_are_refused_by_name_and_ordered_ones_are_not():
    top = texture(0)
    bottom = np.roll(top, -20, axis=0)  # a point is higher in the lower image
    check_order(top, bottom, NAMES, is_whole=False)
    with pytest.raises(ValueError, match="top and bottom image: expected disparities above 0, found"):
        check_order(bottom, top, NAMES, is_whole=False)


def test_what_is_far_bare_or_noise_says_nothing():
    top, bare = texture(0), np.full((200, 320), 90, np.uint8)
    check_order(top, top, NAMES, is_whole=False)
    check_order(bare, bare, NAMES, is_whole=False)
    for seed in range(1, 6):
        check_order(top, texture(seed), NAMES, is_whole=False)
        check_order(texture(seed), top, NAMES, is_whole=False)
    with pytest.raises(ValueError, match="expected disparities above 0"):
        check_order(np.roll(top, -2, axis=0), top, NAMES, is_whole=False)  # two pixels do say something
