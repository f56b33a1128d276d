"""The small picture of a sphere."""

import numpy as np
import pytest

from sphere_nav.geometry import SE3, Spherical
from sphere_nav.spheres.coarse import coarse_sphere
from sphere_nav.spheres.sphere import Sphere
from worlds.room import wide_room

WINDOW = Spherical(270, 202, 1024.0, 300.0, 150.0)


@pytest.mark.parametrize("camera", [Spherical(512, 256), WINDOW], ids=["whole", "window"])
def test_it_shows_the_room_as_its_own_camera_sees_it(camera):
    room = wide_room()
    small = coarse_sphere(room.sphere(SE3.identity(), camera))
    gray, range_m = room.render(small.camera, SE3.identity())
    assert np.median(np.abs(small.image - gray)) < 4.0
    assert np.median(np.abs(small.range_m / range_m - 1.0)) < 0.02


def test_every_size_becomes_about_a_hundred_rows():
    for width, expected in [(2048, 256), (1024, 256), (512, 256), (300, 300)]:
        camera = Spherical(width, width // 2)
        image, range_m = np.full((width // 2, width), 9, np.uint8), np.ones((width // 2, width), np.float32)
        small = coarse_sphere(Sphere(image, range_m, camera))
        assert small.camera.is_whole
        assert (small.camera.width, small.image.min(), small.range_m.max()) == (expected, 9, 1.0)


def test_the_nearest_surface_of_a_block_counts_and_the_unknown_does_not():
    camera = Spherical(400, 200)
    range_m = np.full((200, 400), 20.0, np.float32)
    range_m[0, 0], range_m[:2, 2:4], range_m[0:2, 4:6], range_m[0, 4] = 2.0, np.nan, np.inf, np.nan
    small = coarse_sphere(Sphere(np.full((200, 400), 7, np.uint8), range_m, camera))
    assert small.camera.width == 200
    assert small.range_m[0, 0] == 2.0
    assert np.isnan(small.range_m[0, 1])
    assert small.range_m[0, 2] == np.inf
    assert small.range_m[0, 3] == 20.0
