"""The node cycab_sim on a bus: services, refused commands, and time that passes while it is active."""

import math
import time

import numpy as np
import pytest
from geometry_msgs.msg import TwistStamped
from sphere_nav_msgs.msg import SimulationFault
from sphere_nav_msgs.srv import SetFault, Teleport

from cycab_sim.ros.node import CycabSim
from sphere_nav.ros.bags.replay import OfflineBus, OfflineShell
from sphere_nav.ros.conversions import header
from worlds.patience import Patience

VALUES = {"world": "corridor", "camera.period": 0.0, "clock.real_time_factor": 0.0}


@pytest.fixture(scope="module")
def node():
    node = CycabSim(OfflineShell(OfflineBus(), "cycab_sim", VALUES, {}))
    node.configure()
    return node


def silenced(target):
    return SetFault.Request(fault=SimulationFault(target=target, kind="silent"))


def test_services_answer(node):
    call = node.endpoints.call
    answer = call("set_fault", silenced("sphere"))
    assert answer.success
    assert [(item.target, item.kind) for item in answer.active] == [("sphere", "silent")]
    refused = call("set_fault", silenced("x"))
    assert not refused.success
    assert refused.message.startswith("fault.target: expected one of camera")
    assert call("set_fault", SetFault.Request(clear=True)).active == []
    request = Teleport.Request(speed=0.5)
    request.pose.position.x, request.pose.position.y, request.pose.orientation.w = 20.0, -0.5, 1.0
    assert call("teleport", request).success
    state = node.simulator.vehicle.state
    np.testing.assert_allclose([state.x, state.y, state.yaw, state.speed], [20.0, -0.5, 0.0, 0.5], atol=1e-9)
    request.pose.orientation.w = 0.0
    assert "quaternion" in call("teleport", request).message


def test_a_stamp_of_another_clock_and_numbers_that_are_none_are_refused(node):
    for stamp, speed in ((1_700_000_000 * 10**9, 1.0), (node.simulator.time_ns, math.nan)):
        message = TwistStamped(header=header(stamp, "base_link"))
        message.twist.linear.x = speed
        with pytest.raises(ValueError, match="expected"):
            node.on_command(message)


@pytest.mark.slow
def test_an_inactive_simulator_runs_again_after_each_activation(node):
    for _ in range(3):
        before = node.simulator.time_ns
        node.activate()
        patience = Patience(20.0)
        while node.simulator.time_ns == before and patience.is_left():
            time.sleep(0.001)
        node.deactivate()
        assert node.simulator.time_ns > before
        assert node.endpoints.call("set_fault", SetFault.Request(clear=True)).success
