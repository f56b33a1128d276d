"""The call load_cloud, and our own map as a cloud."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rclpy")

from sphere_nav_msgs.srv import LoadCloud

from mcl_depth.geometry.cloud import Cloud
from mcl_depth.ros.clouds import find_map_id, read_map
from mcl_depth.ros.node import MclDepthNode
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.maps.reader import MapDetails, save_map
from sphere_nav.spheres.graph import KeySphere, SphereGraph
from sphere_nav.spheres.sphere import Sphere


@pytest.fixture
def node():
    bus = OfflineBus()
    yield bus.add(MclDepthNode)
    bus.close()


def loaded(node, path):
    return node.shell.call("load_cloud", LoadCloud.Request(path=str(path)))


def test_a_cloud_is_answered_with_its_size(node, tmp_path):
    points = np.random.default_rng(1).uniform((-4, -3, 0), (4, 3, 2), (500, 3))
    np.save(tmp_path / "room.npy", points)
    answer = loaded(node, tmp_path / "room.npy")
    assert answer.success
    assert 450 < answer.num_points <= 500  # single points in 140 000 voxels: few share one
    low, high = (np.array([corner.x, corner.y, corner.z]) for corner in (answer.minimum, answer.maximum))
    np.testing.assert_allclose([low, high], [points.min(axis=0), points.max(axis=0)], rtol=1e-6)


def test_a_cloud_that_cannot_be_read_leaves_the_present_one(node, tmp_path):
    np.save(tmp_path / "room.npy", np.random.default_rng(1).uniform(0, 4, (500, 3)))
    loaded(node, tmp_path / "room.npy")
    before = node.clouds.geometry
    (tmp_path / "bad.ply").write_text("nothing")
    for name in ("bad.ply", "absent.ply", "room.xyz"):
        answer = loaded(node, tmp_path / name)
        assert not answer.success
        assert name in answer.message
        assert "\n" not in answer.message
    assert node.clouds.geometry is before


def test_the_spheres_of_a_map_are_points_where_they_stood(tmp_path):
    camera = Spherical(32, 16)
    sphere = Sphere(np.full((16, 32), 90, np.uint8), np.full((16, 32), 2.0, np.float32), camera, 1)
    centers = ([0.0, 0.0, 0.0], [10.0, 0.0, 0.0])
    keys = [KeySphere(k, k + 1, SE3.from_parts(np.eye(3), np.array(c)), sphere) for k, c in enumerate(centers)]
    save_map(tmp_path / "map", SphereGraph(keys), MapDetails("yard"))
    np.save(tmp_path / "room.npy", np.zeros((5, 3)))
    assert [find_map_id(str(tmp_path / name)) for name in ("map", "room.npy")] == ["yard", ""]
    cloud = read_map(str(tmp_path / "map"))
    assert isinstance(cloud, Cloud)
    distances = np.linalg.norm(cloud.points[:, None] - np.array(centers), axis=2).min(axis=1)
    np.testing.assert_allclose(distances, 2.0, rtol=1e-3)  # ranges are kept to 0.02 %
    assert np.sum(cloud.points[:, 0] > 5.0) == len(cloud.points) // 2
