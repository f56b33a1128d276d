import numpy as np

from sphere_mapping.map_cloud import MapCloud
from sphere_mapping.params import CloudParams
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.spheres.graph import KeySphere, SphereGraph
from sphere_nav.spheres.sphere import Sphere

CAMERA = Spherical(32, 16)


def node(number, range_m):
    image = np.full((16, 32), 50 + number, np.uint8)
    sphere = Sphere(image, np.full((16, 32), range_m, np.float32), CAMERA)
    return KeySphere(number, number, SE3.from_parts(np.eye(3), [10.0 * number, 0, 0]), sphere)


def cloud_of(*nodes, **values):
    graph = SphereGraph(nodes)
    return MapCloud(CloudParams(**values), lambda sphere_id: graph[sphere_id].sphere).of(graph)


def test_the_newest_spheres_come_first_and_the_number_is_limited():
    points, values = cloud_of(node(0, 3.0), node(1, 3.0), step=1, max_points=600)
    assert len(points) == len(values) == 600
    assert set(values[:512]) == {51}
    np.testing.assert_allclose(np.linalg.norm(points[:512] - [10.0, 0, 0], axis=1), 3.0, rtol=1e-5)


def test_pictures_are_asked_for_once_and_points_move_with_their_spheres():
    asked = []
    cloud = MapCloud(CloudParams(step=4), lambda sphere_id: asked.append(sphere_id) or node(sphere_id, 3.0).sphere)
    cloud.of(SphereGraph([node(0, 3.0)]))
    graph = SphereGraph([node(0, 3.0), node(1, 3.0)])
    before, _ = cloud.of(graph)
    after, _ = cloud.of(graph.with_poses({0: SE3.from_planar(0.0, 5.0, 0.0)}))
    assert asked == [0, 1]
    np.testing.assert_allclose(after[32:] - before[32:], np.tile([0.0, 5.0, 0.0], (32, 1)), atol=1e-5)
    assert np.array_equal(after[:32], before[:32])
