"""Images in the wrong order are refused by name; far ones, bare ones and noise say nothing about it."""

import cv2
import numpy as np
import pytest

from sphere_mapping.acquisition.range.semi_global import check_order

NAMES = ("top", "bottom")


def texture(seed, blur=1.2):
    image = cv2.GaussianBlur(np.random.default_rng(seed).normal(0, 1, (200, 320)), (0, 0), blur)
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
