"""What leaves the node: the pose of the base, the transform to odometry or base, status and diagnostics."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rclpy")

from localization.status import State, Status
from mcl_depth.belief.estimate import Estimate
from mcl_depth.node import MclDepthNode
from mcl_depth.outputs_node import Outputs
from node_kit.conversions import pose_with_covariance_to_se3, se3_to_odometry, transform_to_se3
from node_kit.node import ERROR, OK
from node_kit.replay import OfflineBus
from sphere_geometry import SE3

SECOND = 10**9
T_BASE_EYE = SE3.from_parts(np.eye(3), np.array([0.5, 0.0, 1.2]))
T_MAP_BASE = SE3.from_planar(3.0, -1.0, 0.7)
FOUND = Estimate(Status(State.TRACKING, stamp_ns=SECOND), T_MAP_BASE @ T_BASE_EYE, 0.01 * np.eye(6))


@pytest.fixture
def bus():
    bus = OfflineBus()
    node = bus.add(MclDepthNode)
    assert isinstance(node.outputs, Outputs)
    node.intake.T_base_camera = T_BASE_EYE
    list(bus.settle())
    return bus


def said(bus):
    return {record.topic: record.message for record in bus.settle()}


def test_the_pose_is_that_of_the_base_and_so_is_the_transform(bus):
    bus.nodes[0].outputs.publish(FOUND, SECOND, 12.0)
    answer = said(bus)
    T_map_base, covariance = pose_with_covariance_to_se3(answer["/pose"], "map")
    assert T_map_base.distance(T_MAP_BASE)[0] < 1e-9
    assert covariance[1, 1] > 0.01  # the lever arm turns the heading's error into a distance
    transform = answer["/tf"].transforms[0]
    assert (transform.header.frame_id, transform.child_frame_id) == ("map", "base_link")
    assert answer["/status"].milliseconds == 12.0


def test_with_odometry_the_transform_is_that_of_odom(bus):
    T_map_odom = SE3.from_planar(1.0, 2.0, 0.3)
    odometry = se3_to_odometry(T_map_odom.inverse() @ T_MAP_BASE, np.eye(6), SECOND, ("odom", "base_link"))
    bus.deliver("/odom", odometry)
    bus.nodes[0].outputs.publish(FOUND, SECOND, 12.0)
    transform = said(bus)["/tf"].transforms[0]
    assert (transform.header.frame_id, transform.child_frame_id) == ("map", "odom")
    assert transform_to_se3(transform.transform).distance(T_map_odom)[0] < 1e-9


def test_what_is_not_trusted_is_not_published(bus):
    node = bus.nodes[0]
    node.outputs.publish(Estimate(Status(State.SEARCHING, stamp_ns=SECOND)), SECOND, 1.0)
    assert set(said(bus)) == {"/status"}
    assert node.outputs.state is State.SEARCHING
    assert node.reports["localisation"][0] == ERROR
    node.outputs.tell(Status(State.TRACKING, stamp_ns=2 * SECOND))
    assert node.reports["localisation"][0] == OK
