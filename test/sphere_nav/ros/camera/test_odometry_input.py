"""Odometry of one source: its frame, its stamps, and what /tf knows beside it."""

import numpy as np
from tf2_msgs.msg import TFMessage

from sphere_nav.geometry import SE3
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.camera.odometry_input import OdometryInput
from sphere_nav.ros.conversions import se3_to_odometry, se3_to_transform
from sphere_nav.ros.node import ManagedNode
from sphere_nav.ros.tf import TransformListener

SECOND = 10**9
POSE = SE3.from_planar(1.0, 2.0, 0.3)


class World:
    def __init__(self):
        self.bus = OfflineBus()
        self.node = self.bus.add(ManagedNode)
        self.tf = TransformListener(self.node.endpoints, ignored="map")
        self.odometry = OdometryInput(self.node.endpoints, self.tf, "base_link")

    def odom(self, stamp, frame="odom", pose=POSE):
        self.bus.deliver("/odom", se3_to_odometry(pose, np.eye(6), stamp, (frame, "base_link")))

    def move(self, stamp, parent="odom", child="base_link", topic="/tf", pose=POSE):
        self.bus.deliver(topic, TFMessage(transforms=[se3_to_transform(pose, stamp, parent, child)]))

    @property
    def refusal(self):
        return next(item for item in self.node.inputs if item.topic == "odom").last_refusal


def test_the_topic_gives_frame_and_pose_for_a_short_while():
    world = World()
    assert (world.odometry.frame, world.odometry.at(SECOND)) == ("", None)
    world.odom(SECOND)
    assert world.odometry.frame == "odom"
    np.testing.assert_allclose(world.odometry.at(SECOND).matrix, POSE.matrix, atol=1e-12)
    assert world.odometry.at(2 * SECOND) is None


def test_another_frame_is_refused_and_named_until_a_reset():
    world = World()
    world.odom(SECOND)
    world.odom(SECOND)
    assert "odometry stamp: expected later than 1.000 s, found 1.000 s" in world.refusal
    world.odom(2 * SECOND, "odom_2")
    assert "header.frame_id: expected 'odom' as before, found 'odom_2'" in world.refusal
    assert (world.odometry.frame, world.odometry.at(2 * SECOND)) == ("odom", None)
    world.odometry.reset()
    world.odom(3 * SECOND, "odom_2")
    assert world.odometry.frame == "odom_2"


def test_neither_one_stamp_of_the_future_nor_a_clock_that_is_set_back_an_hour_ends_the_odometry():
    world = World()
    list(world.bus.advance(10 * SECOND))
    world.odom(3600 * SECOND)
    assert "ahead" in world.refusal
    world.odom(10 * SECOND)
    assert world.odometry.at(10 * SECOND) is not None
    world = World()
    world.odom(7200 * SECOND)
    world.odom(3600 * SECOND, pose=POSE @ POSE)
    np.testing.assert_allclose(world.odometry.at(3600 * SECOND).matrix, (POSE @ POSE).matrix, atol=1e-12)


def test_tf_alone_tells_where_the_base_is():
    world = World()
    world.move(SECOND)
    assert (world.odometry.frame, world.odometry.is_on_tf) == ("odom", True)
    np.testing.assert_allclose(world.odometry.in_frame(SECOND).matrix, POSE.matrix, atol=1e-12)
    assert world.odometry.in_frame(2 * SECOND) is None
    assert world.odometry.at(SECOND) is None  # the topic has said nothing


def test_what_is_rigidly_above_the_base_does_not_count_as_odometry():
    world = World()
    footprint = SE3.from_parts(np.eye(3), [0.0, 0.0, 0.3])
    world.move(SECOND, "base_footprint", "base_link", "/tf_static", footprint)
    assert (world.odometry.frame, world.odometry.is_on_tf) == ("", False)
    T_root_base, root = world.odometry.T_root_base
    assert root == "base_footprint"
    np.testing.assert_allclose(T_root_base.matrix, footprint.matrix, atol=1e-12)
    world.move(SECOND, "odom", "base_footprint")
    assert (world.odometry.frame, world.odometry.is_on_tf) == ("odom", True)


def test_our_own_transform_is_not_heard_and_neither_a_truth_nor_a_map_is_odometry():
    world = World()
    world.move(SECOND, "map", "base_link")
    assert not world.odometry.is_on_tf
    world.move(SECOND)
    assert world.odometry.frame == "odom"
    for parent in ["map", "ground_truth", "odom"]:
        world = World()
        for stamp in (SECOND, SECOND + 1000):
            world.move(stamp, parent)
        assert (world.odometry.predict(SECOND) is None) == (parent != "odom")


def test_a_vehicle_that_publishes_odometry_on_tf_alone_is_predicted_by_it():
    world = World()
    world.move(SECOND, "base_footprint", "base_link", "/tf_static", SE3.from_parts(np.eye(3), [0, 0, 0.2]))
    for tenth in range(4):
        world.move(SECOND + tenth * SECOND // 10, "odom", "base_footprint", pose=SE3.from_planar(0.1 * tenth, 0, 0))
    base = world.odometry.predict(SECOND + 250_000_000)
    np.testing.assert_allclose(base.translation, [0.25, 0.0, 0.2], atol=1e-9)
    carried = world.odometry.predict(SECOND + 400_000_000)  # images come before the transform of their time
    np.testing.assert_allclose(carried.translation, [0.4, 0.0, 0.2], atol=1e-9)
    assert world.odometry.predict(2 * SECOND) is None
    assert world.odometry.predict(SECOND - 1) is None
    world.odom(SECOND, pose=POSE)  # the topic goes before it
    np.testing.assert_allclose(world.odometry.predict(SECOND).matrix, POSE.matrix, atol=1e-12)
