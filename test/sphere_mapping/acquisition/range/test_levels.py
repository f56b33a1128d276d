"""Planes of one level at the size of another, and which pixels a wide block says something about."""

import cv2
import numpy as np
import pytest

from sphere_mapping.acquisition.range.levels import fit, interpolate, is_borrowed, is_unlike, spread_around, twice


def waves(height, width):
    v, u = np.mgrid[0:height, 0:width]
    return 128 + 50 * np.sin(2 * np.pi * u / width) * np.cos(2 * np.pi * v / height)


@pytest.mark.parametrize("is_whole", [True, False])
def test_a_slanted_plane_stays_one_at_twice_the_size_and_a_whole_sphere_has_no_seam(is_whole):
    v, u = np.mgrid[0:16, 0:32].astype(np.float32)
    plane = waves(16, 32).astype(np.float32) if is_whole else 0.5 * v + 0.25 * u
    found = interpolate(plane, is_whole)
    np.testing.assert_allclose(found[::2, ::2], 2 * plane)
    between = plane + np.roll(plane, -1, axis=1)
    columns = slice(None) if is_whole else slice(-1)
    np.testing.assert_allclose(found[::2, 1::2][:, columns], between[:, columns], rtol=1e-6)


def test_what_is_unknown_stays_so_with_all_that_would_be_interpolated_from_it():
    plane = np.ones((4, 8), np.float32)
    plane[2, 3] = np.nan
    assert np.isnan(interpolate(plane, False)).sum() == 9
    assert np.isnan(fit(plane, (5, 9))).sum() == 1 + 4 + 9


def test_the_spread_is_that_of_what_is_known_around_and_wraps_around():
    plane = np.full((16, 32), 5.0, np.float32)
    plane[8, 0], plane[8, 10], plane[2, 20] = 9.0, np.nan, 4.0
    plane[10:, 24:] = np.nan
    found = spread_around(plane, 2, is_whole=True)
    expected = np.zeros((16, 32))
    expected[6:11, [30, 31, 0, 1, 2]] = 4.0
    expected[0:5, 18:23] = 1.0
    np.testing.assert_array_equal(found, expected)
    assert spread_around(plane, 2, is_whole=False)[8, 31] == 0.0
    np.testing.assert_array_equal(twice(plane)[::2, ::2], plane)
    np.testing.assert_array_equal(twice(plane)[1::2, 1::2], plane)


def test_unlike_is_what_differs_by_far_more_than_usual_less_of_it_where_the_range_varies():
    unlike, spread, found = (np.full((32, 64), value, np.float32) for value in (0.02, 0.0, 7.0))
    found[:, 32:], unlike[:, 32:] = np.nan, 1e6  # what is not measured does not say what is usual
    unlike[4, 4], unlike[6, 6], unlike[9, 9] = 0.22, 0.18, 0.18
    spread[9, 9] = 0.5
    assert np.argwhere(is_unlike(unlike, spread, found, 10.0)[:, :32]).tolist() == [[4, 4], [9, 9]]
    assert not is_unlike(unlike, spread, np.full_like(found, np.nan), 10.0).any()


def test_what_a_pixel_does_not_show_itself_is_borrowed():
    """A post without texture, along the columns, and the sky above a wall: both have the range of the wall."""
    wall = 120 + 30 * cv2.GaussianBlur(np.random.default_rng(3).normal(0, 1, (128, 160)), (0, 0), 1.5) / 0.19
    images = []
    for seed, image in enumerate((wall, np.roll(wall, -6, axis=0))):
        image = np.clip(image, 60, 180)
        image[:40] = 220
        image[:, 80:88] = 30
        noisy = image + np.random.default_rng(seed).normal(0, 1.0, image.shape)
        images.append(np.rint(noisy).astype(np.uint8))
    disparity = np.full(wall.shape, 6.0, np.float32)
    disparity[60:70, 20:30] = np.nan
    found = is_borrowed(*images, disparity, is_whole=False)
    assert found[20:38, 8:72].mean() > 0.95
    assert found[60:120, 80:88].mean() > 0.95
    assert found[60:120, 95:150].mean() < 0.1
    assert not found[62:68, 22:28].any()  # nothing is known there
    wrong = is_borrowed(*images, disparity + 3, is_whole=False)
    assert wrong[60:120, 95:150].mean() > 0.9  # not what is there, either
    seam = is_borrowed(*(np.roll(image, 40, axis=1) for image in images), np.roll(disparity, 40, axis=1), is_whole=True)
    np.testing.assert_array_equal(np.roll(seam, -40, axis=1)[:, 20:140], found[:, 20:140])
