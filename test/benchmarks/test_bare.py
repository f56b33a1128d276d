"""What the benchmarks of bare geometry compute by themselves: ways, odometry, scores; homes that are drawn."""

import numpy as np

from benchmarks.bare.drives import Drive
from sphere_nav.geometry import SE3, so3


def seen(images, *turns):
    """A drive of a panorama on flat ground whose IMU leans by rotation vectors."""
    odometry = np.array([[0.0, 0.0, 0.1], [1.0, 0.2, 0.3]])
    return Drive(images, SE3.from_matrix(np.tile(np.eye(4), (2, 1, 1))), odometry, np.stack(turns))


def test_a_mirrored_drive_turns_the_other_way_and_leans_to_the_other_side():
    images = np.arange(2 * 3 * 8, dtype=np.uint8).reshape(2, 3, 8)
    drive = seen(images, so3.exp(np.array([0.1, 0.0, 0.0])), so3.exp(np.array([0.0, 0.2, 0.0])))
    mirrored = drive.mirrored
    np.testing.assert_array_equal(mirrored.images[0, 0], images[0, 0, ::-1])
    np.testing.assert_allclose(mirrored.odometry, [[0.0, 0.0, -0.1], [1.0, -0.2, -0.3]])
    np.testing.assert_allclose(so3.log(mirrored.tilts[0]), [-0.1, 0.0, 0.0], atol=1e-12)  # roll
    np.testing.assert_allclose(so3.log(mirrored.tilts[1]), [0.0, 0.2, 0.0], atol=1e-12)  # pitch
    np.testing.assert_array_equal(mirrored.mirrored.images, images)
