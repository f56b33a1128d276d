"""What leaves a localiser: the pose only with trust, a word for every change, map -> odom also between images."""

import numpy as np
import pytest
from tf2_msgs.msg import TFMessage

from sphere_nav.geometry import SE3
from sphere_nav.localization.params import NodeParams
from sphere_nav.localization.status import BaseEstimate, State, Status
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.camera.odometry_input import OdometryInput
from sphere_nav.ros.conversions import (
    pose_with_covariance_to_se3,
    se3_to_odometry,
    se3_to_transform,
    stamp_ns,
    transform_to_se3,
)
from sphere_nav.ros.endpoints import ERROR, OK, WARN
from sphere_nav.ros.localizer.pose_outputs import PoseOutputs
from sphere_nav.ros.node import ManagedNode
from sphere_nav.ros.tf import TransformListener

AHEAD_NS = 100_000_000  # written out: imported, a change would go unseen

SECOND = 10**9
STAMP_NS = 5 * SECOND
T_MAP_ODOM, T_ODOM_BASE = SE3.from_planar(3.0, 1.0, 0.7), SE3.from_planar(1.0, 2.0, 0.3)
T_MAP_BASE = T_MAP_ODOM @ T_ODOM_BASE


class World:
    def __init__(self):
        self.bus, self.now = OfflineBus(), 100 * SECOND
        self.node = self.bus.add(ManagedNode)
        tf = TransformListener(self.node.endpoints, ignored="map")
        odometry = OdometryInput(self.node.endpoints, tf, "base_link")
        self.outputs = PoseOutputs(self.node.endpoints, NodeParams(), odometry, lambda: "yard")
        self.transform = self.outputs._transform
        self.pass_time(0)

    def said(self):
        return {record.topic: record.message for record in self.bus.settle()}

    def pass_time(self, nanoseconds):
        """Let time pass; return what was sent."""
        self.now += nanoseconds
        return self.sent(self.bus.advance(self.now))

    def sent(self, records=None):
        found = [r.message.transforms[0] for r in (records if records is not None else self.bus.settle())]
        return [(item.header.frame_id, item.child_frame_id, stamp_ns(item), item.transform) for item in found]

    def odom(self, stamp=None):
        self.bus.deliver("/odom", se3_to_odometry(T_ODOM_BASE, np.eye(6), stamp or self.now, ("odom", "base_link")))

    def tf(self, stamp=None):
        message = TFMessage(transforms=[se3_to_transform(T_ODOM_BASE, stamp or self.now, "odom", "base_link")])
        self.bus.deliver("/tf", message)

    @property
    def report(self):
        return self.node.reports["tf"][:2]


@pytest.mark.parametrize(
    ("state", "reason", "level"),
    [("TRACKING", "", OK), ("TRACKING", "OVERRUN", WARN), ("DEGRADED", "", WARN), ("LOST", "", ERROR)],
)
def test_a_lost_vehicle_is_an_error_in_the_diagnostics(state, reason, level):
    world = World()
    world.outputs.tell(Status(State(state), reason, stamp_ns=STAMP_NS))
    assert world.node.reports["localisation"][0] == level
    assert world.outputs.state is State(state)


def test_a_turned_vehicle_is_unsure_along_the_axes_of_the_map():
    world, T_map_base = World(), SE3.exp([1.0, 2.0, 0.5, 0.4, -0.8, 1.2])
    local = np.diag([4e-4, 1e-4, 1e-6, 1e-6, 4e-6, 9e-6])  # sure along the view, unsure across
    world.outputs.publish(BaseEstimate(Status(State.TRACKING, stamp_ns=STAMP_NS), T_map_base, local))
    messages = world.said()
    assert list(messages) == ["/pose", "/odometry", "/tf", "/status"]
    assert messages["/status"].map_id == "yard"
    said = [messages["/pose"], messages["/odometry"], messages["/status"]]
    assert [stamp_ns(one) for one in said] == [STAMP_NS] * 3  # when the image was taken, not when it was computed
    fixed = np.array(messages["/pose"].pose.covariance).reshape(6, 6)
    across_map = T_map_base.rotation[:, 0]
    assert across_map @ fixed[:3, :3] @ across_map == pytest.approx(4e-4)
    found, back = pose_with_covariance_to_se3(messages["/pose"], "map")
    np.testing.assert_allclose(found.matrix, T_map_base.matrix, atol=1e-12)
    np.testing.assert_allclose(back, local, atol=1e-15)
    assert messages["/odometry"].twist.covariance[0] >= 1e6  # no velocity yet: not known, not zero


def test_a_state_that_flickers_is_logged_once_in_a_while(caplog):
    world = World()
    with caplog.at_level("INFO"):
        for number in range(100):
            state = State.TRACKING if number % 2 else State.DEGRADED
            world.outputs.tell(Status(state, "" if number % 2 else "GAP", stamp_ns=STAMP_NS))
    assert [record.message.split(":")[0] for record in caplog.records] == ["DEGRADED", "TRACKING"]


# --- its part of /tf
def test_without_odometry_the_base_is_below_the_map():
    world = World()
    world.transform.update(T_MAP_BASE, world.now)
    [(parent, child, stamp, transform)] = world.sent()
    assert (parent, child, stamp) == ("map", "base_link", world.now)
    assert transform_to_se3(transform).distance(T_MAP_BASE)[0] < 1e-12
    assert world.pass_time(SECOND) == []  # nobody knows how the base goes on
    assert world.report == (OK, "map -> base_link")
    T_root_base = SE3.from_parts(np.eye(3), [0.1, 0.0, 0.3])
    mount = se3_to_transform(T_root_base, world.now, "base_footprint", "base_link")
    world.bus.deliver("/tf_static", TFMessage(transforms=[mount]))
    world.transform.update(T_MAP_BASE, world.now)
    [(_, child, _, transform)] = world.sent()
    assert child == "base_footprint"  # what is rigidly above the base is where that says
    assert (transform_to_se3(transform) @ T_root_base).distance(T_MAP_BASE)[0] < 1e-12


@pytest.mark.parametrize("source", ["odom", "tf"])
def test_with_odometry_it_is_sent_ahead_and_between_images(source):
    world = World()
    getattr(world, source)()
    world.transform.update(T_MAP_BASE, world.now)
    first, *later = world.sent() + world.pass_time(SECOND)
    assert first[:3] == ("map", "odom", world.now - SECOND + AHEAD_NS)
    assert transform_to_se3(first[3]).distance(T_MAP_ODOM)[0] < 1e-9
    stamps = [first[2], *(stamp for _, _, stamp, _ in later)]
    assert {item[:2] for item in later} == {("map", "odom")}
    assert np.all(np.diff(stamps) > 0)
    assert np.all(np.diff(stamps) <= AHEAD_NS)  # look-ups at the present never extrapolate
    assert stamps[-1] >= world.now
    expected = (OK, "map -> odom") if source == "tf" else (WARN, "nobody publishes odom -> base_link on /tf")
    assert world.report[0] == expected[0]
    assert expected[1] in world.report[1]


def test_odometry_on_tf_may_come_after_the_image():
    world = World()
    world.tf()
    world.now += SECOND // 20
    list(world.bus.advance(world.now))
    world.transform.update(T_MAP_BASE, world.now)
    assert world.sent() == []
    world.tf(world.now + SECOND // 50)
    assert [item[:2] for item in world.pass_time(SECOND // 10)] == [("map", "odom")] * 2


def test_silent_odometry_is_told_after_half_a_second_and_nothing_is_sent():
    world = World()
    world.odom()
    world.transform.update(T_MAP_BASE, world.now)
    world.pass_time(SECOND)
    world.sent()
    for _ in range(8):
        world.transform.update(T_MAP_BASE, world.now)
        world.sent()
        last = world.pass_time(SECOND // 10)
    assert last == []
    assert world.report == (ERROR, "map -> odom is not sent: no odometry at the stamps of the images")


@pytest.mark.parametrize(("waited_ms", "is_told"), [(450, False), (550, True)])
def test_odometry_that_stopped_is_told_after_half_a_second(waited_ms, is_told):
    world = World()
    world.tf()
    list(world.bus.advance(world.now))
    world.transform.update(T_MAP_BASE, world.now + SECOND // 100)
    world.pass_time(waited_ms * 10**6)
    assert (world.node.reports.get("tf", (OK, ""))[0] == ERROR) == is_told


def test_nothing_is_sent_while_nobody_knows_the_pose():
    world = World()
    world.odom()
    world.transform.update(T_MAP_BASE, world.now)
    assert len(world.sent()) == 1
    world.transform.stop()
    assert world.pass_time(SECOND) == []


@pytest.mark.parametrize("age_ms", [900, 1100, -50])
def test_an_image_of_this_time_is_sent_ahead_of_now_and_one_of_another_ahead_of_itself(age_ms):
    """Up to a second late it is of this time; later, or of the future, it is of another clock."""
    world = World()
    stamp = world.now - age_ms * 10**6
    world.odom(stamp)
    world.transform.update(T_MAP_BASE, stamp)
    first, *later = world.sent() + world.pass_time(SECOND // 2)
    start = world.now - SECOND // 2
    expected = start if 0 <= age_ms < 1000 else stamp
    assert first[2] == expected + 100_000_000
    assert later[-1][2] == pytest.approx(expected + SECOND // 2 + 100_000_000, abs=50_000_001)  # 20 a second
    assert len(later) in (9, 10)


def test_no_vehicle_gets_two_parents_in_the_tree():
    world = World()
    world.transform.update(T_MAP_BASE, world.now)
    assert world.sent()[0][:2] == ("map", "base_link")
    world.pass_time(SECOND // 10)
    world.tf()
    world.transform.update(T_MAP_BASE, world.now)
    assert {item[:2] for item in world.sent() + world.pass_time(SECOND // 5)} == {("map", "odom")}
