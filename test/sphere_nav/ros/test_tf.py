"""Frames are looked up through the tree, interpolated in time, and refused with the reason."""

import numpy as np
import pytest
from tf2_msgs.msg import TFMessage

from sphere_nav.geometry import SE3
from sphere_nav.ros.bags import BagReader
from sphere_nav.ros.bags.replay import OfflineBus, replay
from sphere_nav.ros.conversions import se3_to_transform
from sphere_nav.ros.node import ManagedNode
from sphere_nav.ros.tf import TransformBroadcaster, TransformError, TransformListener, TransformTree

SECOND = 1_000_000_000
T_BASE_CAMERA = SE3.exp([0.2, 0.0, 1.1, 0.0, 0.1, 0.3])
T_MAP_ODOM = SE3.from_planar(1.0, 2.0, 0.5)


def odom_base(seconds):
    return SE3.exp(np.array([0.5, 0.1, 0.0, 0.0, 0.0, 0.4]) * seconds)


@pytest.fixture
def tree():
    tree = TransformTree()
    tree.add(se3_to_transform(T_BASE_CAMERA, 0, "base_link", "camera"), is_static=True)
    tree.add(se3_to_transform(T_MAP_ODOM, 0, "/map", "odom"), is_static=True)
    for number in range(5):
        tree.add(se3_to_transform(odom_base(number), number * SECOND, "odom", "base_link"))
    return tree


@pytest.mark.parametrize("seconds", [0.0, 1.0, 2.25, 3.9, 4.0])
def test_a_transform_is_the_product_along_the_tree(tree, seconds):
    found = tree.lookup("map", "camera", round(seconds * SECOND))
    expected = T_MAP_ODOM @ odom_base(seconds) @ T_BASE_CAMERA  # constant twist: interpolation is exact
    np.testing.assert_allclose(found.matrix, expected.matrix, atol=1e-9)
    np.testing.assert_allclose(
        (found @ tree.lookup("camera", "map", round(seconds * SECOND))).matrix, np.eye(4), atol=1e-12
    )


def test_without_a_stamp_the_newest_holds(tree):
    np.testing.assert_allclose(tree.lookup("odom", "base_link").matrix, odom_base(4).matrix, atol=1e-12)
    np.testing.assert_allclose(tree.lookup("camera", "camera").matrix, np.eye(4))


def test_a_stamp_outside_of_what_was_heard(tree):
    with pytest.raises(
        TransformError, match=r"odom -> base_link: expected stamp 4\.500 s, found up to \+0\.500 s away"
    ):
        tree.lookup("map", "camera", round(4.5 * SECOND))
    tree.lookup("base_link", "camera", 99 * SECOND)  # static ones hold always


def test_unknown_and_unconnected_frames(tree):
    with pytest.raises(TransformError, match="frame lidar: expected one of base_link, camera, map, odom, found none"):
        tree.lookup("map", "lidar")
    tree.add(se3_to_transform(SE3.identity(), 0, "other", "lidar"), is_static=True)
    with pytest.raises(TransformError, match="map and lidar are not connected: map is below map, lidar is below other"):
        tree.lookup("map", "lidar")


def test_two_parents_and_bad_numbers_are_refused(tree):
    with pytest.raises(ValueError, match="camera: expected parent base_link, found a second one, map"):
        tree.add(se3_to_transform(SE3.identity(), 0, "map", "camera"))
    with pytest.raises(ValueError, match="expected two frames"):
        tree.add(se3_to_transform(SE3.identity(), 0, "map", "map"))
    message = se3_to_transform(SE3.identity(), 0, "map", "new")
    message.transform.translation.x = float("nan")
    with pytest.raises(ValueError, match=r"transform map -> new\.position: expected finite"):
        tree.add(message)


def test_what_moves_is_forgotten_in_time_and_when_the_clock_jumps(tree):
    tree.add(se3_to_transform(odom_base(12), 12 * SECOND, "odom", "base_link"))
    with pytest.raises(TransformError, match="found up to"):
        tree.lookup("odom", "base_link", SECOND)
    tree.add(se3_to_transform(odom_base(0), 0, "odom", "base_link"))  # far back: a bag began again
    np.testing.assert_allclose(tree.lookup("odom", "base_link").matrix, np.eye(4), atol=1e-12)
    tree.clear()
    with pytest.raises(TransformError, match="nothing heard since the clock jumped"):
        tree.lookup("odom", "base_link")
    tree.lookup("base_link", "camera")


class Teller(ManagedNode):
    NAME = "teller"

    def configure(self):
        self.moving = TransformBroadcaster(self.endpoints)
        self.fixed = TransformBroadcaster(self.endpoints, is_static=True)


class Hearer(ManagedNode):
    NAME = "hearer"

    def configure(self):
        self.tf = TransformListener(self.endpoints)


def test_what_is_told_is_heard(make_bag):
    bus = OfflineBus()
    teller, hearer = bus.add(Teller), bus.add(Hearer)
    teller.fixed.send(T_BASE_CAMERA, 1, "base_link", "camera")
    teller.fixed.send(T_MAP_ODOM, 1, "map", "odom")
    teller.moving.send(odom_base(1), SECOND, "odom", "base_link")
    sent = [item.message for item in bus.settle()]
    assert all(isinstance(message, TFMessage) for message in sent)
    assert [len(message.transforms) for message in sent] == [1, 2, 1]  # the static ones are repeated
    expected = T_MAP_ODOM @ odom_base(1) @ T_BASE_CAMERA
    np.testing.assert_allclose(hearer.tf.lookup("map", "camera", SECOND).matrix, expected.matrix, atol=1e-9)


def test_a_real_recording(shared_data):
    bus = OfflineBus()
    hearer = bus.add(Hearer)
    with BagReader(shared_data / "bags" / "nav2_turtlebot.mcap") as bag:
        assert list(replay(bag, bus)) == []
    assert hearer.inputs[0].num_refused == 0
    T_odom_scan = hearer.tf.lookup("odom", "rplidar_link")
    assert np.isfinite(T_odom_scan.matrix).all()
