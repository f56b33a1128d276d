from itertools import pairwise

import numpy as np
import pytest

from sphere_nav.geometry import Pinhole, Spherical
from sphere_nav.geometry.cameras.camera import pixel_grid
from sphere_nav.photometric.pixels.kernels import UNKNOWN
from sphere_nav.photometric.pixels.reference import in_codes, is_spaced, keep_evenly_spaced

SPHERE = Spherical(256, 128)
WINDOW = Spherical(100, 40, 256, 30.0, 5.0)  # of the same sphere, near its upper pole


@pytest.mark.parametrize("camera", [WINDOW])
def test_a_row_has_as_many_points_as_its_circle_has_room_for(camera):
    is_kept = is_spaced(camera)
    cosine = np.cos(np.arcsin(camera.unproject(pixel_grid(camera)[:, 0])[..., 2]))
    assert is_kept.shape == (camera.height, camera.width)
    assert np.all(np.abs(is_kept.sum(axis=1) - camera.width * cosine) <= 1)


def test_ranges_stay_where_a_point_is_and_other_cameras_keep_all():
    ranges = in_codes(np.full((SPHERE.height, SPHERE.width), 2.0, np.float32))
    spaced = ranges.copy()
    keep_evenly_spaced(spaced, SPHERE)
    np.testing.assert_array_equal(spaced != UNKNOWN, is_spaced(SPHERE))
    np.testing.assert_array_equal(spaced[is_spaced(SPHERE)], ranges[is_spaced(SPHERE)])
    lens = Pinhole(20, 10, 10.0, 10.0, 9.5, 4.5)
    keep_evenly_spaced(some := ranges[:10, :20].copy(), lens)
    np.testing.assert_array_equal(some, ranges[:10, :20])


def test_each_row_begins_a_golden_part_of_a_pixel_after_the_one_above():
    """A row keeps a pixel where the way along its circle, from where it begins, passes a whole pixel."""
    is_kept, camera = is_spaced(SPHERE), SPHERE
    for row in (0, 7, camera.height // 3, camera.height // 2):
        begin = row * (np.sqrt(5.0) - 1.0) / 2.0 % 1.0
        step = np.cos(np.pi * ((row + 0.5) / camera.height - 0.5))
        passed = [int(begin + step * k) for k in range(camera.width + 1)]
        assert is_kept[row].tolist() == [after > before for before, after in pairwise(passed)]
