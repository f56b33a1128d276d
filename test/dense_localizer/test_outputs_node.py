import numpy as np
import pytest

pytest.importorskip("rclpy")

from dense_localizer.estimate import Estimate
from dense_localizer.node import DenseLocalizerNode
from dense_localizer.outputs_node import Outputs
from localization.status import State, Status, describe
from node_kit.conversions import pose_with_covariance_to_se3
from node_kit.node import ERROR, OK, WARN
from node_kit.replay import OfflineBus
from sphere_geometry import SE3

STAMP_NS = 5_000_000_000


@pytest.fixture
def bench():
    bus = OfflineBus()
    node = bus.add(DenseLocalizerNode)
    return bus, node, Outputs(node)


def said(bus):
    return {record.topic: record.message for record in bus.settle()}


@pytest.mark.parametrize(("state", "level"), [("TRACKING", OK), ("DEGRADED", WARN), ("LOST", ERROR), ("NO_MAP", ERROR)])
def test_the_diagnostics_follow_the_state(bench, state, level):
    _, node, outputs = bench
    outputs.tell(Status(State(state), stamp_ns=STAMP_NS))
    assert node.reports["localisation"][0] == level


def test_a_status_reads_as_one_line_with_its_remedy():
    status = Status(State.LOST, "OUTLIERS", 0.2, 0.4, "wait", stamp_ns=STAMP_NS)
    assert describe(status) == "LOST: OUTLIERS (0.2, limit 0.4): wait"
    assert describe(Status(State.TRACKING)) == "TRACKING"


def test_without_trust_only_the_status_goes_out(bench):
    bus, _, outputs = bench
    outputs.publish(Estimate(Status(State.PROBATION, stamp_ns=STAMP_NS)), 3.0)
    assert set(said(bus)) == {"/status"}


def test_the_covariance_goes_out_about_the_fixed_axes_of_the_map(bench):
    bus, _, outputs = bench
    T_map_camera = SE3.exp([1.0, 2.0, 0.5, 0.4, -0.8, 1.2])
    local = np.diag([4e-4, 1e-4, 1e-6, 1e-6, 4e-6, 9e-6])  # sure along the view, unsure across
    outputs.publish(Estimate(Status(State.TRACKING, stamp_ns=STAMP_NS), T_map_camera, local), 3.0)
    messages = said(bus)
    fixed = np.array(messages["/pose"].pose.covariance).reshape(6, 6)
    across_map = T_map_camera.rotation[:, 0]
    assert across_map @ fixed[:3, :3] @ across_map == pytest.approx(4e-4)
    found, back = pose_with_covariance_to_se3(messages["/pose"], "map")
    np.testing.assert_allclose(found.matrix, T_map_camera.matrix, atol=1e-12)
    np.testing.assert_allclose(back, local, atol=1e-15)
    assert messages["/odometry"].twist.covariance[0] >= 1e6  # no velocity yet: not known, not zero
