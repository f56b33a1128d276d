"""Simulator and follower as processes over DDS, time waiting for each answer: the same drive whatever stops a process.

What stands for the localiser is in this process: it answers each image by the true pose.
"""

import os
import signal
import time
from functools import partial

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import Image
from sphere_nav_msgs.msg import LocalizationStatus
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from cycab_sim.params import SimParams
from cycab_sim.simulator import Simulator
from cycab_sim.vehicle import VehicleCommand
from path_follower.ros.node import PathFollowerNode
from sphere_nav.localization.status import State, Status
from sphere_nav.params import build
from sphere_nav.ros import qos
from sphere_nav.ros.bags.replay import OfflineBus, OfflineShell
from sphere_nav.ros.conversions import (
    odometry_to_se3,
    se3_to_odometry,
    se3_to_pose_with_covariance,
    stamp_ns,
    status_to_message,
)
from sphere_nav_tools.cli.processes import Processes
from worlds.patience import wait_until

pytestmark = pytest.mark.dds

SEED, NUM_IMAGES = 5, 24
LIMIT = 120.0  # s; kernels may have to be compiled first
SIMULATION = {
    "seed": SEED,
    "world": "corridor",
    "camera.period": 0.2,
    "camera.size": "64,48",
    "odometry.period": 0.05,
    "render.shadow_texel": 0.5,
    "clock.is_strict": True,
    "clock.pause_at": 1.6,
}
FOLLOWER = {"enable_stamped_cmd_vel": True}
PAUSE_NS = 1_600_000_000


class Bench:
    """The localiser's part, and the operator's."""

    def __init__(self, context):
        self.node = rclpy.create_node("bench", context=context)
        self.executor = SingleThreadedExecutor(context=context)
        self.executor.add_node(self.node)
        self.truth, self.images, self.is_paused = {}, [], False
        self.disturb = {}  # number of an image: what happens before it is answered
        self.poses = self.node.create_publisher(PoseWithCovarianceStamped, "pose", qos.STATE)
        self.states = self.node.create_publisher(LocalizationStatus, "status", qos.STATE)
        self.node.create_subscription(Odometry, "ground_truth/odometry", self.on_truth, qos.STATE)
        self.node.create_subscription(Image, "image_raw", self.on_image, qos.LARGE)
        self.node.create_subscription(Bool, "paused", self.on_paused, qos.LATCHED)

    def on_truth(self, message):
        self.truth[stamp_ns(message)] = odometry_to_se3(message)[0]
        self.answer()

    def on_image(self, message):
        self.images.append(stamp_ns(message))
        self.disturb.get(len(self.images), bool)()
        self.answer()

    def on_paused(self, message):
        self.is_paused = message.data

    def answer(self):
        """Answer the last image once its true pose is known: they come by topics of their own."""
        if not self.images or len(self.images) > NUM_IMAGES or self.images[-1] not in self.truth:
            return
        stamp = self.images[-1]
        self.poses.publish(se3_to_pose_with_covariance(self.truth[stamp], 1e-4 * np.eye(6), stamp, "map"))
        self.states.publish(status_to_message(Status(State.TRACKING, milliseconds=1.0), stamp, "map"))

    def wait(self, is_done):
        is_in_time = wait_until(is_done, LIMIT, lambda: self.executor.spin_once(timeout_sec=0.05))
        assert is_in_time, "expected an answer in time"

    def call(self, name):
        client = self.node.create_client(Trigger, name)
        self.wait(client.service_is_ready)
        answer = client.call_async(Trigger.Request())
        self.wait(answer.done)
        assert answer.result().success, answer.result().message


def stop_for(pid, seconds):
    """Stop a process and let it go on, as a busy machine does with any."""
    os.kill(pid, signal.SIGSTOP)
    time.sleep(seconds)
    os.kill(pid, signal.SIGCONT)


def drive(folder, stops, domain):
    """Drive over DDS; return the true poses. `stops`: number of an image, who stops before its answer, seconds."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    bench = Bench(context)
    try:
        with Processes(folder, domain) as processes:
            processes.start("path_follower", FOLLOWER | {"trajectory": str(folder / "path.csv"), "use_sim_time": True})
            bench.wait(lambda: bench.poses.get_subscription_count() and bench.states.get_subscription_count())
            processes.start("cycab_sim", SIMULATION)
            for number, name, seconds in stops:
                bench.disturb[number] = partial(stop_for, processes.running[name].pid, seconds)
            bench.wait(lambda: bench.is_paused)
            bench.call("path_follower/start")
            bench.call("cycab_sim/resume")
            bench.wait(lambda: len(bench.images) > NUM_IMAGES)
            bench.wait(lambda: bench.images[NUM_IMAGES] in bench.truth)
    finally:
        bench.executor.shutdown()
        bench.node.destroy_node()
        rclpy.shutdown(context=context)
    return bench.truth


def drive_alone(folder, simulator):
    """Drive without DDS, processes and wall time; return the true poses."""
    bus, truth, command, num_images = OfflineBus(), {}, VehicleCommand(), 0
    follower = bus.add(PathFollowerNode, FOLLOWER | {"trajectory": str(folder / "path.csv")})
    while num_images <= NUM_IMAGES:
        now = bus.now_ns = simulator.time_ns
        due = simulator.take_due()
        if "odom" in due:
            state = se3_to_odometry(simulator.T_world_base, np.zeros((6, 6)), now, ("world", "base_link"), np.zeros(6))
            truth[now] = odometry_to_se3(state)[0]
        if "camera" in due:
            num_images += 1
            bus.deliver("/pose", se3_to_pose_with_covariance(truth[now], 1e-4 * np.eye(6), now, "map"))
            bus.deliver("/status", status_to_message(Status(State.TRACKING), now, "map"))
            (twist,) = [m.message for m in bus.settle() if m.topic == "/cmd_vel" and stamp_ns(m.message) == now]
            command = VehicleCommand(twist.twist.linear.x, twist.twist.angular.z)
        if now == PAUSE_NS and "camera" in due:
            assert follower.endpoints.call("start").success
        simulator.step(command, 10_000_000)
    return truth


def test_a_process_that_is_stopped_for_a_while_changes_no_drive_over_dds(tmp_path, domain, monkeypatch):
    monkeypatch.setattr(OfflineShell, "is_time_simulated", True)
    simulator = Simulator(build(SimParams, SIMULATION))
    path = simulator.path.at(np.arange(0.0, 12.0, 0.5))
    np.savetxt(tmp_path / "path.csv", path[:, :2], delimiter=",", fmt="%.6f")
    alone = drive_alone(tmp_path, simulator)
    stops = [(6, "path_follower", 1.2), (9, "cycab_sim", 0.7), (14, "path_follower", 2.0), (20, "cycab_sim", 0.3)]
    stopped = drive(tmp_path, stops, domain)
    for stamp, T_world_base in alone.items():
        time_s = f"{stamp / 1e9:.2f} s"
        np.testing.assert_allclose(stopped[stamp].matrix, T_world_base.matrix, rtol=0, atol=1e-9, err_msg=time_s)
    assert len(alone) == 4 * NUM_IMAGES + 1
    assert np.linalg.norm(alone[max(alone)].translation - alone[min(alone)].translation) > 0.5  # it did drive
