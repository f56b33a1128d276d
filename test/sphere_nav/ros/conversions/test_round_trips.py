"""What goes into a message comes out of its bytes again: frames turned about all axes, no two numbers alike."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from scipy.spatial.transform import Rotation

from sphere_nav.geometry import SE3, Fisheye, Pinhole, Spherical
from sphere_nav.localization.status import Status
from sphere_nav.ros import conversions as to
from sphere_nav.ros.conversions.beliefs import particles_to_message
from sphere_nav.ros.conversions.clouds import features_to_message, message_to_features
from sphere_nav.ros.conversions.graphs import experiences_to_messages, messages_to_experiences
from sphere_nav.spheres.appearance.features import Features
from sphere_nav.spheres.graph import Edge, Experience, KeySphere, SphereGraph

POSE = SE3.exp([1.0, -2.0, 0.5, 0.4, -0.3, 2.1])
OTHER = SE3.exp([-3.0, 0.7, 2.5, -0.9, 0.6, 0.2])
ROOT = np.random.default_rng(5).normal(size=(6, 6))
COVARIANCE = (ROOT @ ROOT.T + np.diag(np.arange(1.0, 7.0))) * 1e-3
TWIST = np.array([1.5, -0.25, 0.125, 0.03, -0.07, 0.4])
STAMP = 1_700_000_000_123_456_789
RAYS = np.random.default_rng(6).normal(size=(4, 3))
FEATURES = Features(
    (RAYS / np.linalg.norm(RAYS, axis=1, keepdims=True)).astype(np.float32),
    np.array([2.0, np.nan, 3.5, 9.0], np.float32),
    np.random.default_rng(7).integers(0, 256, (4, 128), dtype=np.uint8),
)
KEY_SPHERES = [
    KeySphere(7, STAMP, POSE, region_radius_m=7.5, served=3.5, last_served_ns=STAMP + 5,
              experience=Experience("night", "front", "second", STAMP - 9)),
    KeySphere(4, STAMP + 1, OTHER, served=0.5, last_served_ns=STAMP + 8),
]  # fmt: skip
GRAPH = SphereGraph(KEY_SPHERES, [Edge(7, 4, OTHER, np.linalg.inv(COVARIANCE), is_loop=True)])
STATUS = Status(
    "DEGRADED", "OUTLIERS", 0.25, 0.5, "look", 0.625, (3, 7), 0.75, 0.375, 4.5, 12, 6.5, 0.125, 9, 0.875, "yard"
)
POSES = [(STAMP, POSE), (STAMP + 3, OTHER)]
CAMERAS = [
    Pinhole(640, 480, 525.0, 520.0, 319.5, 241.0, (0.1, -0.2, 0.001, 0.002, 0.03)),
    Pinhole(640, 480, 525.0, 520.0, 319.5, 241.0, (0.1, -0.2, 0.001, 0.002, 0.03, 0.04, 0.05, 0.06)),
    Fisheye(800, 700, 260.0, 261.0, 400.0, 399.0, (0.01, -0.02, 0.003, 0.001)),
]


def odometry(message: Any) -> Any:
    return to.odometry_to_se3(message), to.from_ros_covariance(message.pose.covariance, POSE)


def particles(message: Any) -> Any:
    return [(to.pose_to_se3(one.pose), one.weight) for one in message.particles]


# What is sent, its message, and what is read from that; None: the same as what was sent.
TRIPS: dict[str, tuple[Any, Any, Any, Any]] = {
    "pose": (POSE, to.se3_to_pose, to.pose_to_se3, None),
    "stamped": (POSE, lambda pose: to.se3_to_pose_stamped(pose, STAMP, "map"), lambda m: to.pose_to_se3(m.pose), None),
    "transform": (POSE, lambda pose: to.se3_to_transform(pose, STAMP, "map", "base"),
                  lambda m: to.transform_to_se3(m.transform), None),
    "uncertain": ((POSE, COVARIANCE), lambda both: to.se3_to_pose_with_covariance(*both, STAMP, "map"),
                  lambda m: to.pose_with_covariance_to_se3(m, "map"), None),
    "odometry": (POSE, lambda pose: to.se3_to_odometry(pose, COVARIANCE, STAMP, ("map", "base"), TWIST, np.eye(6)),
                 odometry, ((POSE, TWIST), COVARIANCE)),
    "path": (POSES, lambda poses: to.poses_to_path(poses, STAMP, "map"), to.path_to_poses, None),
    "particles": (np.array([[1.0, -2.0, 0.5]]), lambda one: particles_to_message(one, np.array([0.25]), STAMP, "map"),
                  particles, [(SE3.from_planar(1.0, -2.0, 0.5), 0.25)]),
    "cloud": (RAYS.astype(np.float32), lambda one: to.cloud_to_message(one, STAMP, "map"), to.message_to_cloud, None),
    "features": ((FEATURES, np.arange(4)), lambda both: features_to_message(*both, STAMP, "map"),
                 message_to_features, None),
    "graph": (GRAPH, lambda graph: to.graph_to_message(graph, "map", map_id="yard", version=3),
              lambda m: [to.message_to_graph(m).nodes, to.message_to_graph(m).edges],
              [{node.id: replace(node, served=0.0, last_served_ns=0, experience=Experience()) for node in KEY_SPHERES},
               GRAPH.edges]),
    "status": (STATUS, lambda status: to.status_to_message(status, STAMP, "map"), to.message_to_status,
               replace(STATUS, stamp_ns=STAMP)),
    "window": (Spherical(20, 8, 50.5, 3.25, 4.5), lambda camera: to.camera_to_sphere_info(camera, "map"),
               to.sphere_info_to_camera, None),
    **{f"camera {number}": (camera, lambda camera: to.camera_to_info(camera, STAMP, "map"), to.camera_from_info, None)
       for number, camera in enumerate(CAMERAS)},
}  # fmt: skip


def assert_same(found: Any, expected: Any) -> None:
    if isinstance(expected, SE3):
        np.testing.assert_allclose(found.matrix, expected.matrix, atol=1e-9)
    elif is_dataclass(expected):
        for field in fields(expected):
            assert_same(getattr(found, field.name), getattr(expected, field.name))
    elif isinstance(expected, np.ndarray):
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9)
    elif isinstance(expected, dict):
        assert found.keys() == expected.keys()
        assert_same(list(found.values()), [expected[key] for key in found])
    elif isinstance(expected, list | tuple):
        for one, other in zip(found, expected, strict=True):
            assert_same(one, other)
    else:
        assert found == expected


@pytest.mark.parametrize("name", TRIPS)
def test_what_one_vehicle_says_another_hears(name: str) -> None:
    sent, to_message, read, expected = TRIPS[name]
    message = to_message(sent)
    heard = deserialize_message(serialize_message(message), type(message))
    assert_same(read(heard), sent if expected is None else expected)
    if hasattr(message, "header") and message.header.frame_id:
        assert (message.header.frame_id, to.stamp_ns(heard)) == ("map", heard_stamp(name))


def heard_stamp(name: str) -> int:
    return {"graph": STAMP + 1, "window": 0}.get(name, STAMP)


def test_the_lights_of_a_map_come_back_to_their_key_spheres() -> None:
    messages = experiences_to_messages(GRAPH, "map")
    bare = to.message_to_graph(to.graph_to_message(GRAPH, "map"))
    found = messages_to_experiences(bare, [deserialize_message(serialize_message(m), type(m)) for m in messages])
    assert_same([found.nodes[node.id] for node in KEY_SPHERES], KEY_SPHERES)


def test_a_turned_body_stands_and_looks_where_it_does() -> None:
    """What comes back could have been turned twice the wrong way: positions, and an independent quaternion."""
    pose, transform = to.se3_to_pose(POSE), to.se3_to_transform(POSE, STAMP, "map", "base").transform
    for position, turn in ((pose.position, pose.orientation), (transform.translation, transform.rotation)):
        np.testing.assert_allclose([position.x, position.y, position.z], POSE.translation)
        matrix = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
        np.testing.assert_allclose(matrix, POSE.rotation, atol=1e-12)
    message = to.se3_to_odometry(POSE, COVARIANCE, STAMP, ("map", "base"), TWIST, np.diag(np.arange(1.0, 7.0)))
    assert (message.header.frame_id, message.child_frame_id) == ("map", "base")
    linear, angular = message.twist.twist.linear, message.twist.twist.angular
    np.testing.assert_allclose([linear.x, linear.y, linear.z, angular.x, angular.y, angular.z], TWIST)
    np.testing.assert_allclose(message.twist.covariance[::7], np.arange(1.0, 7.0))
