"""The node cycab_sim without a world; with one: test/nodes/test_cycab_sim.py."""

from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from geometry_msgs.msg import Twist, Vector3

from cycab_sim.params import SimParams
from cycab_sim.ros.node import CycabSim
from cycab_sim.runner import LockStep, Runner
from cycab_sim.vehicle import VehicleCommand


def test_a_twist_drives_and_turns_the_car_one_step_on_in_time():
    steps, params = [], SimParams(has_stamped_command=False)
    simulator = SimpleNamespace(params=params, time_ns=10**9, take_due=list, step=lambda *step: steps.append(step))
    lock_step = LockStep(params.clock)
    node = SimpleNamespace(simulator=simulator, params=params, lock_step=lock_step)
    CycabSim.on_command(node, Twist(linear=Vector3(x=1.5), angular=Vector3(z=-0.2)))
    Runner(simulator, lock_step, lambda _: None).turn()
    assert steps == [(VehicleCommand(1.5, -0.2), 10_000_000)]
