"""Which cloud belongs to an instant, and where it was taken."""

import numpy as np

from sphere_mapping.acquisition.params import CloudParams
from sphere_mapping.acquisition.range.clouds import Clouds, mount_of
from sphere_nav.params import build

MS = 1_000_000


def cloud(value):
    return np.full((1, 3), value, np.float32)


def test_the_nearest_in_time_is_taken_within_the_limit():
    clouds = Clouds(build(CloudParams, {"max_age_s": 0.06}))
    assert clouds.at(0) is None
    clouds.add(100 * MS, cloud(1))
    clouds.add(200 * MS, cloud(2))
    assert clouds.at(120 * MS)[0, 0] == 1
    assert clouds.at(170 * MS)[0, 0] == 2
    assert clouds.at(261 * MS) is None
    assert clouds.has_since(200 * MS)
    assert not clouds.has_since(201 * MS)
    clouds.clear()
    assert clouds.at(100 * MS) is None


def test_the_mount_is_turned_about_the_axes_of_the_rig():
    """Looking to the left (yaw 90) and rolled: forward of the LiDAR is the rig's left, its left points up."""
    mount = mount_of(build(CloudParams, {"x": 1.0, "z": 2.0, "yaw_deg": 90.0, "roll_deg": 90.0}))
    found = mount.apply(np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
    np.testing.assert_allclose(found, [[1.0, 1.0, 2.0], [1.0, 0.0, 3.0]], atol=1e-12)
