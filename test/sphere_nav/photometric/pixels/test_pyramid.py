"""Levels keep their geometry, and a whole sphere has no seam."""

import numpy as np
import pytest

from sphere_nav.geometry import Pinhole, Spherical
from sphere_nav.photometric import PyramidParams, build_pyramid
from sphere_nav.photometric.pixels.pyramid import hide, match_sharpness


def test_levels_halve_image_and_camera_together(rng):
    camera = Pinhole(101, 64, 80.0, 80.0, 50.0, 31.5)
    image = rng.integers(0, 255, (64, 101)).astype(np.uint8)
    pyramid = build_pyramid(image, camera, PyramidParams(num_levels=3, min_side=8))
    assert [image.shape for image in pyramid.images] == [(64, 101), (32, 50), (16, 25)]
    assert np.shares_memory(pyramid.images[0], image)
    assert pyramid.cameras[1].cx == pytest.approx((50.0 + 0.5) / 2 - 0.5)


def test_turning_a_whole_sphere_turns_every_level(rng):
    camera = Spherical(128, 64)
    image = rng.uniform(0, 255, (64, 128)).astype(np.float32)
    turned = build_pyramid(np.roll(image, 16, axis=1), camera, PyramidParams(num_levels=3, min_side=8))
    straight = build_pyramid(image, camera, PyramidParams(num_levels=3, min_side=8))
    for shift, a, b in zip((16, 8, 4), turned.images, straight.images, strict=True):
        assert np.allclose(a, np.roll(b, shift, axis=1), atol=1e-4)


def test_an_image_of_another_size_or_kind_is_refused():
    for image in [np.zeros((30, 41), np.uint8), np.zeros((30, 40, 3), np.uint8), np.zeros((30, 40))]:
        with pytest.raises(ValueError, match="image: expected"):
            build_pyramid(image, Pinhole(40, 30, 30.0, 30.0, 19.5, 14.5))


@pytest.mark.parametrize(("sharper", "width"), [(0.1, 160), (1.5, 160), (1.6, 80), (3.1, 80), (3.2, 40), (99.0, 40)])
def test_an_image_much_sharper_than_the_map_is_compared_as_the_map_can_show_it(sharper, width):
    camera = Pinhole(160, 120, 310.0, 310.0, 79.5, 59.5)
    pyramid = build_pyramid(np.zeros((120, 160), np.uint8), camera, PyramidParams(num_levels=4, min_side=8))
    found = match_sharpness(pyramid, camera.pixels_per_radian / sharper)
    assert found.cameras[0].width == width
    assert found.levels[-1] is pyramid.levels[-1]


def test_a_hidden_cell_and_half_of_its_neighbours_are_unknown_at_every_level(rng):
    camera, cells = Pinhole(64, 48, 50.0, 50.0, 31.5, 23.5), np.zeros((3, 4), bool)
    cells[1, 2] = True
    image = rng.integers(0, 255, (48, 64)).astype(np.uint8)
    pyramid = build_pyramid(image, camera, PyramidParams(num_levels=3, min_side=8))
    for before, after in zip(pyramid.images, hide(pyramid, cells).images, strict=True):
        half = before.shape[0] // 6
        expected = before.astype(np.float32)
        expected[half : 5 * half, 3 * half : 7 * half] = np.nan
        assert np.array_equal(after, expected, equal_nan=True)
