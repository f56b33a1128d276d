"""Frames are looked up through the tree, interpolated in time, and refused with the reason."""

import numpy as np
import pytest
from tf2_msgs.msg import TFMessage

from sphere_nav.geometry import SE3
from sphere_nav.ros import qos
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.conversions import se3_to_transform
from sphere_nav.ros.node import WARN, ManagedNode
from sphere_nav.ros.tf import TransformError, TransformListener, TransformTree

SECOND = 1_000_000_000
T_BASE_CAMERA = SE3.exp([0.2, 0.0, 1.1, 0.0, 0.1, 0.3])
T_MAP_ODOM = SE3.from_planar(1.0, 2.0, 0.5)


def odom_base(seconds):
    return SE3.exp(np.array([0.5, 0.1, 0.0, 0.0, 0.0, 0.4]) * seconds)


@pytest.fixture
def tree():
    tree = TransformTree()
    tree.add(se3_to_transform(T_BASE_CAMERA, 0, "base_link", "camera"), is_static=True)
    tree.add(se3_to_transform(T_MAP_ODOM, 0, "map", "odom"), is_static=True)
    for number in range(5):
        tree.add(se3_to_transform(odom_base(number), number * SECOND, "odom", "base_link"))
    return tree


@pytest.mark.parametrize("seconds", [2.25, 4.0])
def test_a_transform_is_the_product_along_the_tree(tree, seconds):
    found = tree.lookup("map", "camera", round(seconds * SECOND))
    expected = T_MAP_ODOM @ odom_base(seconds) @ T_BASE_CAMERA  # constant twist: interpolation is exact
    np.testing.assert_allclose(found.matrix, expected.matrix, atol=1e-9)
    back = tree.lookup("camera", "map", round(seconds * SECOND))
    np.testing.assert_allclose((found @ back).matrix, np.eye(4), atol=1e-12)


def test_a_stamp_outside_of_what_was_heard(tree):
    expected = r"odom -> base_link: expected stamp 4\.500 s, found up to \+0\.500 s away"
    with pytest.raises(TransformError, match=expected):
        tree.lookup("map", "camera", round(4.5 * SECOND))
    tree.lookup("base_link", "camera", 99 * SECOND)  # static ones hold always


def test_frames_that_are_unknown_unconnected_or_of_two_parents_are_refused(tree):
    with pytest.raises(TransformError, match="frame lidar: expected one of base_link, camera, map, odom, found none"):
        tree.lookup("map", "lidar")
    tree.add(se3_to_transform(SE3.identity(), 0, "other", "lidar"), is_static=True)
    with pytest.raises(TransformError, match="map and lidar are not connected: map is below map, lidar is below other"):
        tree.lookup("map", "lidar")
    with pytest.raises(ValueError, match="camera: expected parent base_link, found a second one, map"):
        tree.add(se3_to_transform(SE3.identity(), 0, "map", "camera"))
    with pytest.raises(ValueError, match="expected no loop"):
        tree.add(se3_to_transform(SE3.identity(), 0, "map", "map"))


def test_a_transform_from_before_the_clock_jumped_places_nothing(tree):
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
        self.moving = self.add_publisher("/tf", TFMessage)
        self.fixed = self.add_publisher("/tf_static", TFMessage, qos.LATCHED)


class Hearer(ManagedNode):
    NAME = "hearer"

    def configure(self):
        self.tf = TransformListener(self.endpoints)


# --- several parents
def edge(parent, child, seconds=None, x=0.0):
    """Return arguments of `add`: one that moves at these seconds, or a static one."""
    transform = se3_to_transform(SE3.from_planar(x, 0.0, 0.0), round((seconds or 0) * SECOND), parent, child)
    return {"message": transform, "is_static": seconds is None}


def test_the_latest_static_parent_holds_and_the_change_names_both():
    tree = TransformTree()
    assert tree.add(**edge("wrong", "camera", 1.0)) == ""  # also before one that moves
    assert tree.add(**edge("base_link", "camera", x=1.0)) == "transform: camera: parent wrong is replaced by base_link"
    assert tree.lookup("base_link", "camera", 99 * SECOND).translation[0] == 1.0
    assert tree.add(**edge("mast", "camera", x=2.0)) == "transform: camera: parent base_link is replaced by mast"
    anew = "transform mast -> camera: told twice, 1.000 m and 0.0 deg apart: the later one holds"
    assert tree.add(**edge("mast", "camera", x=3.0)) == anew
    assert tree.add(**edge("mast", "camera", x=3.0)) == ""
    assert tree.lookup("mast", "camera").translation[0] == 3.0
    with pytest.raises(ValueError, match="camera: expected parent mast, found a second one, wrong"):
        tree.add(**edge("wrong", "camera", 1000.0))
    assert tree.moving_edge("camera") is None


def test_a_parent_that_moves_holds_while_it_is_heard():
    tree = TransformTree()
    for seconds in (1.0, 1.5, 2.0):
        tree.add(**edge("odom", "base_link", seconds, x=seconds))
    for late in (0.0, 2.0, 2.5, 3.0):
        with pytest.raises(ValueError, match="base_link: expected parent odom, found a second one, wrong"):
            tree.add(**edge("wrong", "base_link", late))
    assert tree.lookup("odom", "base_link", round(1.75 * SECOND)).translation[0] == pytest.approx(1.75)
    change = "transform: base_link: parent odom is replaced by wrong"
    assert tree.add(**edge("wrong", "base_link", 3.01)) == change
    with pytest.raises(TransformError, match=r"wrong -> base_link: expected stamp 2\.000 s"):
        tree.lookup("wrong", "base_link", 2 * SECOND)  # what was heard below another parent is forgotten


def test_one_wrong_parent_does_not_lock_the_right_one_out():
    """Neither when it came first, nor with a stamp far ahead, nor before the clock jumped."""
    tree = TransformTree()
    tree.add(**edge("wrong", "base_link", 1.0))
    assert tree.add(**edge("odom", "base_link", 2.1))
    assert tree.add(**edge("wrong", "base_link", 2.0**31 - 1))
    assert tree.add(**edge("odom", "base_link", 2.2))
    tree.clear()
    assert tree.add(**edge("map", "base_link", 2.2))
    assert tree.root("base_link") == "map"


def test_frames_never_form_a_loop():
    tree = TransformTree()
    tree.add(**edge("odom", "base_link", 1.0))
    tree.add(**edge("base_link", "camera", 1.0))
    with pytest.raises(ValueError, match="camera -> odom: expected no loop, found odom above camera"):
        tree.add(**edge("camera", "odom", 1.5))
    assert tree.root("camera") == "odom"
    for below in range(97):
        tree.add(**edge(f"{below - 1}" if below else "camera", f"{below}", 1.0))
    with pytest.raises(ValueError, match="96 -> 97: expected at most 100 frames up to the root"):
        tree.add(**edge("96", "97", 1.0))


def test_a_change_of_parent_is_reported_and_a_second_parent_that_moves_is_refused():
    bus = OfflineBus()
    teller, hearer = bus.add(Teller), bus.add(Hearer)
    for parent in ("base_link", "mast"):
        teller.fixed.publish(TFMessage(transforms=[edge(parent, "camera")["message"]]))
    for parent in ("odom", "wrong", "odom"):
        teller.moving.publish(TFMessage(transforms=[edge(parent, "base_link", 1.0)["message"]]))
    list(bus.settle())
    change = "transform: camera: parent base_link is replaced by mast"
    assert hearer.reports["tf parents"] == (WARN, change, {})
    assert hearer.inputs[0].last_refusal == "transform: base_link: expected parent odom, found a second one, wrong"
    assert [wanted.num_refused for wanted in hearer.inputs] == [1, 0]
    assert hearer.tf.lookup("mast", "camera").distance(SE3.identity()) == (0.0, 0.0)
    assert hearer.tf.moving_edge("base_link") is not None
