"""The node cycab_sim on a bus: services, refused commands, and time that passes while it is active."""

import math
import threading
import time

import pytest
from geometry_msgs.msg import Twist, TwistStamped, Vector3
from sphere_nav_msgs.msg import SimulationFault
from sphere_nav_msgs.srv import SetFault, Teleport

from cycab_sim.ros.node import CycabSim
from cycab_sim.runner import PAUSE
from cycab_sim.vehicle import VehicleCommand
from sphere_nav.geometry import SE3
from sphere_nav.ros import conversions
from sphere_nav.ros.bags.replay import OfflineBus, OfflineShell
from worlds.patience import wait_until


def offline(**values):
    """A node that is configured, and its bus; names of parameters have __ for dots."""
    bus = OfflineBus()
    given = {"world": "corridor", "camera.size": "16,16", "sphere.width": 0, "clock.real_time_factor": 0.0}
    given |= {"render.shadow_texel": 0.5} | {name.replace("__", "."): value for name, value in values.items()}
    node = CycabSim(OfflineShell(bus, "cycab_sim", given, {}))
    node.configure()
    return node, bus


@pytest.fixture(scope="module", autouse=True)
def first_steps():
    """The kernels that a first step loads are of no test alone."""
    node, _ = offline(camera__period=0.0)
    run_a_step(node)


def run_a_step(node):
    before = node.simulator.time_ns
    node.activate()
    wait_until(lambda: node.simulator.time_ns > before, 20.0, lambda: time.sleep(0.001))
    node.deactivate()
    assert node.simulator.time_ns > before


def test_a_stamp_of_another_clock_and_numbers_that_are_none_are_refused():
    node, _ = offline(camera__period=0.0)
    for stamp, speed in ((1_700_000_000 * 10**9, 1.0), (node.simulator.time_ns, math.nan)):
        message = TwistStamped(header=conversions.header(stamp, "base_link"), twist=Twist(linear=Vector3(x=speed)))
        with pytest.raises(ValueError, match="expected"):
            node.on_command(message)


def test_an_inactive_simulator_answers_calls_and_runs_again_after_each_activation():
    node, _ = offline(camera__period=0.0)
    fault = SimulationFault(target="odom", kind="slip", magnitude=0.5, start=3.0, duration=2.0)
    answer = node.endpoints.call("set_fault", SetFault.Request(fault=fault))
    assert (answer.success, answer.active) == (True, [fault])
    wrong = SimulationFault(target="x", kind="silent")
    refused = node.endpoints.call("set_fault", SetFault.Request(fault=wrong))
    assert (refused.success, refused.active) == (False, [fault])
    assert refused.message.startswith("fault.target: expected one of camera")
    assert "nothing to resume" in node.endpoints.call("resume").message
    pose = conversions.se3_to_pose(SE3.from_planar(20.0, -0.5, 0.3))
    teleport = threading.Thread(target=node.endpoints.call, args=("teleport", Teleport.Request(pose=pose, speed=0.7)))
    with node.runner.lock:  # in the middle of a step
        teleport.start()
        teleport.join(0.02)
        assert node.simulator.vehicle.state.x != 20.0
    teleport.join(20.0)
    pose.orientation.w = pose.orientation.z = 0.0
    assert "quaternion" in node.endpoints.call("teleport", Teleport.Request(pose=pose)).message
    state = node.simulator.vehicle.state
    assert (state.x, state.y, state.yaw, state.speed) == pytest.approx((20.0, -0.5, 0.3, 0.7))
    for _ in range(3):
        run_a_step(node)
        assert node.endpoints.call("set_fault", SetFault.Request(clear=True)).active == []


def test_time_is_told_with_whom_it_waits_for_and_goes_on_when_asked():
    node, bus = offline(clock__is_strict=True)
    assert node.find_lack() == "a publisher of cmd_vel"  # who sees the images is there
    for _ in range(2):
        node.tell_waiting(PAUSE)
    said = [(one.topic, one.message) for one in bus.settle()]
    assert [topic for topic, _ in said] == ["/clock", "/paused", "/clock"]
    assert conversions.time_to_ns(said[0][1].clock) == node.simulator.time_ns
    assert node.endpoints.call("resume").success
    assert node.runner.resumed.is_set()
    assert [node.hand_out(name) for name in ("clock", "odom", "camera")] == [None, None, node.simulator.time_ns]
    for wrong in ({"camera__period": 0.0}, {"has_stamped_command": False}):
        with pytest.raises(ValueError, match=r"clock\.is_strict: expected has_stamped_command and camera\.period > 0"):
            offline(clock__is_strict=True, **wrong)


def test_commands_drive_by_their_stamp_and_without_one_by_their_arrival():
    twist = Twist(linear=Vector3(x=1.5), angular=Vector3(z=-0.2))
    for message in (TwistStamped(header=conversions.header(10**9, ""), twist=twist), TwistStamped(twist=twist), twist):
        node, _ = offline(has_stamped_command=message is not twist, camera__period=0.0)
        node.on_command(message)
        node.runner.turn()
        assert node.simulator._applied == VehicleCommand(1.5, -0.2)
