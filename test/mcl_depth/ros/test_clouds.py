"""The call load_cloud, and our own map as a cloud."""

from __future__ import annotations

import numpy as np
import pytest
from sphere_nav_msgs.srv import LoadCloud

from mcl_depth.ros.clouds import read_map
from mcl_depth.ros.node import MclDepthNode
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.localization.status import BaseEstimate, State, Status
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
    return node.endpoints.call("load_cloud", LoadCloud.Request(path=str(path)))


def test_a_cloud_is_answered_with_its_size(node, tmp_path):
    points = np.random.default_rng(1).uniform((-4, -3, 0), (4, 3, 2), (500, 3))
    np.save(tmp_path / "room.npy", points)
    answer = loaded(node, tmp_path / "room.npy")
    assert answer.success
    assert 450 < answer.num_points <= 500  # single points in 140 000 voxels: few share one
    low, high = (np.array([corner.x, corner.y, corner.z]) for corner in (answer.minimum, answer.maximum))
    np.testing.assert_allclose([low, high], [points.min(axis=0), points.max(axis=0)], rtol=1e-6)


def test_a_cloud_that_cannot_be_read_leaves_the_present_one_and_only_the_log_says_why(node, tmp_path, caplog):
    np.save(tmp_path / "room.npy", np.random.default_rng(1).uniform(0, 4, (500, 3)))
    loaded(node, tmp_path / "room.npy")
    before = node.clouds.geometry
    (tmp_path / "bad.ply").write_text("nothing")
    (tmp_path / "room.xyz").write_text("nothing")
    answers = [
        loaded(node, tmp_path / name) for name in ("bad.ply", "absent.ply", "room.xyz", ".", "a\0b", "bad.ply/x")
    ]
    answers += [loaded(node, path) for path in ("/etc/passwd", "/dev/null", "/etc")]
    (told,) = {(answer.success, answer.message) for answer in answers}
    assert told == (False, "path: expected a cloud or map, found none that can be read: the log of mcl_depth says why")
    assert "bad.ply: header: expected 'ply'" in caplog.text
    assert node.clouds.geometry is before


def test_another_cloud_is_made_ready_anew(node, tmp_path, caplog):
    caplog.set_level("INFO")
    for side in (3.0, 4.0):
        np.save(tmp_path / f"{side}.npy", np.random.default_rng(1).uniform(0.0, side, (500, 3)))
        loaded(node, tmp_path / f"{side}.npy")
        node.clouds.make_filter(Spherical(512, 256), 1.0)
    assert caplog.text.count("places are made ready") == 2


def test_a_pose_is_published_as_latitude_and_longitude_where_the_system_is_known(tmp_path):
    points = np.random.default_rng(1).uniform((-4, -3, 0), (4, 3, 2), (500, 3))
    np.save(tmp_path / "room.npy", points + np.array([500_000.0, 4_982_950.4, 120.0]))
    bus = OfflineBus()
    node = bus.add(MclDepthNode, {"cloud": str(tmp_path / "room.npy"), "survey.crs": "EPSG:32632"})
    origin = np.array(node.clouds.geometry.origin)
    quarter = SE3.from_planar(0.0, 0.0, np.pi / 2)
    pose = SE3.from_parts(quarter.rotation, np.array([500_000.0, 4_982_950.4, 121.5]) - origin)
    covariance = np.diag([0.04, 0.01, 0.09, 1e-3, 1e-3, 1e-3])  # along the way, which leads north
    node.clouds.tell_fix(BaseEstimate(Status(State.TRACKING), pose, covariance), 7)
    node.clouds.tell_fix(BaseEstimate(Status(State.SEARCHING)), 8)
    (fix,) = (item.message for item in bus.settle() if item.topic == "/fix")
    assert (fix.latitude, fix.longitude, fix.altitude) == pytest.approx((45.0, 9.0, 121.5), abs=1e-8)
    np.testing.assert_allclose(np.diag(np.reshape(fix.position_covariance, (3, 3))), [0.01, 0.04, 0.09], atol=1e-12)
    assert (fix.position_covariance_type, fix.header.frame_id) == (3, "base_link")
    silent = bus.add(MclDepthNode, {"cloud": str(tmp_path / "room.npy"), "survey.crs": "auto"})  # declares none
    silent.clouds.tell_fix(BaseEstimate(Status(State.TRACKING), pose, covariance), 9)
    assert not [item for item in bus.settle() if item.topic == "/fix"]
    bus.close()


def test_the_spheres_of_a_map_are_points_where_they_stood(tmp_path):
    camera = Spherical(32, 16)
    sphere = Sphere(np.full((16, 32), 90, np.uint8), np.full((16, 32), 2.0, np.float32), camera, 1)
    centers = ([0.0, 0.0, 0.0], [10.0, 0.0, 0.0])
    keys = [KeySphere(k, k + 1, SE3.from_parts(np.eye(3), np.array(c)), sphere) for k, c in enumerate(centers)]
    save_map(tmp_path / "map", SphereGraph(keys), MapDetails("yard"))
    cloud = read_map(str(tmp_path / "map"))
    assert (cloud.map_id, cloud.is_mesh) == ("yard", False)
    distances = np.linalg.norm(cloud.points[:, None] - np.array(centers), axis=2).min(axis=1)
    np.testing.assert_allclose(distances, 2.0, rtol=1e-3)  # ranges are kept to 0.02 %
    assert np.sum(cloud.points[:, 0] > 5.0) == len(cloud.points) // 2
