import numpy as np
import pytest

from sphere_geometry import SE3, Spherical
from sphere_map.graph import KeySphere, SphereGraph
from sphere_map.sphere import Sphere
from sphere_mapping.graph.map_cloud import cloud_of, points_of
from sphere_mapping.params import CloudParams

CAMERA = Spherical(32, 16)


def node(number, range_m, colour=False):
    image = np.full((16, 32, 3) if colour else (16, 32), 50 + number, np.uint8)
    sphere = Sphere(image, np.full((16, 32), range_m, np.float32), CAMERA)
    return KeySphere(number, number, SE3.from_parts(np.eye(3), [10.0 * number, 0, 0]), sphere)


def test_points_are_in_the_map_frame_at_their_range():
    points, values = points_of(node(2, 3.0), CloudParams(step=1))
    assert points.shape == (512, 3)
    np.testing.assert_allclose(np.linalg.norm(points - [20.0, 0, 0], axis=1), 3.0, rtol=1e-5)
    assert set(values) == {52}


def test_far_points_are_left_out_and_steps_thin():
    assert len(points_of(node(0, 60.0), CloudParams(step=1))[0]) == 0
    assert len(points_of(node(0, 3.0), CloudParams(step=4))[0]) == 32


def test_the_newest_spheres_come_first_and_the_number_is_limited():
    points, values = cloud_of(SphereGraph([node(0, 3.0), node(1, 3.0)]), CloudParams(step=1, max_points=600))
    assert len(points) == len(values) == 600
    assert set(values[:512]) == {51}


def test_colour_is_kept_and_grey_wins_over_a_mixture():
    assert cloud_of(SphereGraph([node(0, 3.0, True)]))[1].shape[1:] == (3,)
    assert cloud_of(SphereGraph([node(0, 3.0, True), node(1, 3.0)]))[1].ndim == 1


def test_spheres_that_are_not_in_memory_give_nothing():
    empty = KeySphere(0, 0, SE3.identity())
    assert cloud_of(SphereGraph([empty]))[0].shape == (0, 3)
    with pytest.raises(ValueError, match="key sphere 0: expected its picture in memory"):
        points_of(empty, CloudParams())
