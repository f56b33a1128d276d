import numpy as np
import pytest

from dense_localizer.params import LocalizerParams
from dense_localizer.references.prefetch import PixelPrefetch
from sphere_nav.geometry import SE3
from sphere_nav.params import build
from sphere_nav.photometric import prepare_reference
from sphere_nav.photometric.pixels.selection import choose_pixels, holds, image_speed
from worlds.localizer import PINHOLE, SMALL_IMAGES, at

PARAMS = build(LocalizerParams, SMALL_IMAGES).registration
NUMBER = PARAMS.max_pixels // 2
STILL = np.zeros(6)


def reference_of(room_map):
    sphere = room_map.graph[0].sphere
    return prepare_reference(sphere.gray, sphere.range_m, sphere.camera, PARAMS)


def chosen_of(reference, T):
    return reference.level_like(PINHOLE).selections.get((PINHOLE, NUMBER))


def test_pixels_are_chosen_before_they_are_needed_and_used_when_asked(room_map):
    reference, T = reference_of(room_map), at(0.0).inverse()
    pixels = PixelPrefetch(PARAMS, is_live=False)
    pixels.begin(0, reference, T, STILL, PINHOLE, 2)
    pixels.begin(0, reference, at(1.0).inverse(), STILL, PINHOLE, 2)  # one at a time
    assert chosen_of(reference, T) is None
    pixels.use(0)  # waits
    chosen = chosen_of(reference, T)
    assert np.array_equal(chosen.T_camera_reference.matrix, T.matrix)
    assert choose_pixels(reference.level_like(PINHOLE), T, PINHOLE, NUMBER) is chosen
    pixels.begin(0, reference, T @ SE3.exp([0, 0, 0, 0, 0.01, 0]), STILL, PINHOLE, 2)  # moved too little
    pixels.use(0)
    assert chosen_of(reference, T) is chosen
    pixels.begin(0, reference, T @ SE3.exp([0, 0, 0, 0, 0, 0.1]), STILL, PINHOLE, 2)
    pixels.use(0)
    assert chosen_of(reference, T) is not chosen
    pixels.close()


def test_what_is_not_looked_at_any_more_is_forgotten(room_map):
    reference = reference_of(room_map)
    pixels = PixelPrefetch(PARAMS, is_live=False)
    pixels.begin(0, reference, at(0.0).inverse(), STILL, PINHOLE, 2)
    pixels.forget({1})
    pixels.use(0)
    assert chosen_of(reference, at(0.0).inverse()) is None
    pixels.close()


@pytest.mark.parametrize("twist", [[0, 0, 8.0, 0, 0, 0], [0, 0, 0, 0, 2.0, 0]])
def test_what_is_chosen_ahead_serves_the_next_image_however_fast_the_camera(room_map, twist):
    reference, T, velocity = reference_of(room_map), at(0.0).inverse(), np.array(twist, float)
    pixels, level = PixelPrefetch(PARAMS, is_live=False), reference.level_like(PINHOLE)
    for chosen in pixels.choose(reference, T, PINHOLE, 2):
        chosen.keep()
    period = min(1.0 / 30.0, 0.15 / image_speed(level, velocity, PINHOLE, NUMBER))  # s, and 15 % of the width at most
    for image in range(6):
        T_now = SE3.exp(-velocity * period * image) @ T
        pixels.use(0)
        assert holds(level, T_now, PINHOLE, NUMBER)
        pixels.begin(0, reference, T_now, velocity, PINHOLE, 2)
    pixels.close()
