"""What leaves a localiser: the pose only with trust, covariance about the axes of the map, a word for every change."""

import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.localization.params import NodeParams
from sphere_nav.localization.status import BaseEstimate, State, Status
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.camera.odometry_input import OdometryInput
from sphere_nav.ros.conversions import pose_with_covariance_to_se3, stamp_ns
from sphere_nav.ros.endpoints import ERROR, OK, WARN
from sphere_nav.ros.localizer.pose_outputs import PoseOutputs
from sphere_nav.ros.node import ManagedNode
from sphere_nav.ros.tf import TransformTree

STAMP_NS = 5_000_000_000


class World:
    def __init__(self):
        self.bus = OfflineBus()
        self.node = self.bus.add(ManagedNode)
        odometry = OdometryInput(self.node.endpoints, TransformTree(), "base_link")
        self.outputs = PoseOutputs(self.node.endpoints, NodeParams(), odometry, lambda: "yard")

    def said(self):
        return {record.topic: record.message for record in self.bus.settle()}


def test_a_lost_vehicle_is_an_error_in_the_diagnostics():
    for state, reason, level in [
        ("TRACKING", "", OK),
        ("TRACKING", "OVERRUN", WARN),
        ("DEGRADED", "", WARN),
        ("LOST", "", ERROR),
    ]:
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
