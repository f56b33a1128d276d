"""The node cycab_sim over real DDS: lock-step with commands, outputs that belong together, services, a clean end."""

import math
import signal
import subprocess
import sys
import time
from collections import defaultdict

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist, TwistStamped, Vector3
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image, Imu, LaserScan
from sphere_nav_msgs.msg import AugmentedSphere, SimulationFault
from sphere_nav_msgs.srv import SetFault, Teleport
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from cycab_sim.ros.node import CycabSim
from cycab_sim.runner import PAUSE
from cycab_sim.vehicle import VehicleCommand
from sphere_nav.geometry import SE3
from sphere_nav.ros import conversions, qos
from sphere_nav.ros.bags.replay import OfflineBus, OfflineShell
from sphere_nav.ros.conversions import camera_from_info, image_to_array, message_to_sphere, stamp_ns
from worlds.patience import Patience

START_LIMIT = 120.0  # s; kernels may have to be compiled first
SMALL = {
    "seed": 5,
    "world": "ramp",
    "camera.size": "160,120",
    "sphere.width": 128,
    "capture.when": "always",
    "render.shadow_texel": 0.5,
    "clock.max_wait": 30.0,
    "imu.is_on": True,
    "scan.is_on": True,
}
TOPICS = {
    "image_raw": (Image, qos.LARGE),
    "camera_info": (CameraInfo, qos.STATE),
    "sphere": (AugmentedSphere, qos.LARGE),
    "odom": (Odometry, qos.STATE),
    "ground_truth/odometry": (Odometry, qos.STATE),
    "imu": (Imu, qos.STATE),
    "scan": (LaserScan, qos.STATE),
    "/tf_static": (TFMessage, qos.TF_STATIC),
    "/clock": (Clock, qos.STATE),
    "/diagnostics": (DiagnosticArray, qos.STATE),
}


class Driver:
    """Answers every image with a command, and keeps everything that was published."""

    def __init__(self, context):
        self.node = rclpy.create_node("driver", context=context)
        self.executor = SingleThreadedExecutor(context=context)
        self.executor.add_node(self.node)
        self.heard = defaultdict(list)
        self.is_answering = True
        self.commands = self.node.create_publisher(TwistStamped, "cmd_vel", qos.COMMAND)
        for topic, (kind, profile) in TOPICS.items():
            self.node.create_subscription(kind, topic, self.keeper(topic), profile)

    def keeper(self, topic):
        def keep(message):
            self.heard[topic].append(message)
            if topic == "image_raw" and self.is_answering:
                self.command(message.header)

        return keep

    def command(self, header, speed=1.0):
        message = TwistStamped(header=header)
        message.twist.linear.x = speed
        self.commands.publish(message)

    def stand(self):
        """Leave an image unanswered, so that time stands and no command is under way; return the number of images."""
        self.is_answering = False
        count = len(self.heard["image_raw"])
        assert self.spin_until(lambda: len(self.heard["image_raw"]) > count, 60.0)
        self.spin_until(lambda: False, 0.5)
        return len(self.heard["image_raw"])

    def go_on(self):
        """Answer again, from the last image on."""
        self.is_answering = True
        self.command(self.heard["image_raw"][-1].header)

    def num_refused(self):
        """Return how many commands the simulator has refused, by its newest diagnostics."""
        told = [status for array in self.heard["/diagnostics"] for status in array.status]
        told = [status for status in told if status.name == "cycab_sim: input cmd_vel"]
        return int({item.key: item.value for item in told[-1].values}["refused"]) if told else 0

    def spin_until(self, condition, seconds):
        patience = Patience(seconds)
        while not condition() and patience.is_left():
            self.executor.spin_once(timeout_sec=0.05)
        return condition()


@pytest.fixture(scope="module")
def process():
    arguments = [item for name, value in SMALL.items() for item in ("-p", f"{name}:={value}")]
    command = [sys.executable, "-c", "from cycab_sim.ros.node import main; raise SystemExit(main())", "--ros-args"]
    with subprocess.Popen([*command, *arguments], stderr=subprocess.PIPE, text=True) as running:
        yield running
        if running.poll() is None:
            running.kill()


@pytest.fixture(scope="module")
def driver(process):
    context = rclpy.Context()
    rclpy.init(context=context)
    driver = Driver(context)
    assert driver.spin_until(lambda: driver.heard["image_raw"], START_LIMIT), "no image came"
    yield driver
    driver.executor.shutdown()
    driver.node.destroy_node()  # else it is seen, as one who commands, by the tests that follow
    rclpy.shutdown(context=context)


@pytest.mark.dds
def test_time_passes_with_the_commands_only(driver, process):
    assert driver.spin_until(lambda: len(driver.heard["image_raw"]) >= 15, 60.0)
    before = driver.stand()
    driver.spin_until(lambda: False, 0.7)
    assert len(driver.heard["image_raw"]) == before  # no command, no time
    driver.go_on()
    assert driver.spin_until(lambda: len(driver.heard["image_raw"]) > before + 3, 60.0)
    stamps = np.array([stamp_ns(message) for message in driver.heard["image_raw"]])
    assert set(np.diff(stamps)) == {100_000_000}


@pytest.mark.dds
def test_image_calibration_and_frames_belong_together(driver):
    driver.spin_until(lambda: driver.heard["/tf_static"] and driver.heard["sphere"], 60.0)
    image = driver.heard["image_raw"][-1]  # of the first ones the other topic may not yet have been found

    def its_info():
        return next((info for info in driver.heard["camera_info"] if stamp_ns(info) == stamp_ns(image)), None)

    assert driver.spin_until(lambda: its_info() is not None, 60.0)
    info = its_info()
    camera = camera_from_info(info)
    assert image_to_array(image).shape == (camera.height, camera.width) == (120, 160)
    assert info.header.frame_id == image.header.frame_id
    names = {t.child_frame_id: t.header.frame_id for t in driver.heard["/tf_static"][0].transforms}
    assert names == dict.fromkeys(("camera_optical", "sphere_link", "imu_link", "scan_link"), "base_link")
    sphere = message_to_sphere(driver.heard["sphere"][0])
    assert sphere.image.shape == (64, 128, 3)
    assert np.isinf(sphere.range_m).any()  # the sky
    assert not np.isnan(sphere.range_m).any()


@pytest.mark.dds
def test_a_stamp_of_another_clock_and_numbers_that_are_none_are_refused(driver):
    count = driver.stand()
    foreign = Header(stamp=Time(sec=1_700_000_000))
    for header, speed in ((foreign, 1.0), (driver.heard["image_raw"][-1].header, math.nan)):
        before = driver.num_refused()
        driver.command(header, speed)
        assert driver.spin_until(lambda before=before: driver.num_refused() > before, 60.0)
    assert len(driver.heard["image_raw"]) == count  # neither lets time pass
    driver.go_on()
    assert driver.spin_until(lambda: len(driver.heard["image_raw"]) > count + 2, 60.0)  # and the drive goes on


@pytest.mark.dds
def test_a_simulator_ends_in_order(driver, process):
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=120.0) == 0
    assert "Traceback" not in process.stderr.read()


def offline(**values):
    """A node that is configured, and its bus; names of parameters have __ for dots."""
    bus = OfflineBus()
    given = {"world": "corridor", "camera.size": "16,16", "sphere.width": 0, "clock.real_time_factor": 0.0}
    given |= {"render.shadow_texel": 0.5} | {name.replace("__", "."): value for name, value in values.items()}
    node = CycabSim(OfflineShell(bus, "cycab_sim", given, {}))
    node.configure()
    return node, bus


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
    assert node.endpoints.call("teleport", Teleport.Request(pose=pose, speed=0.7)).success
    pose.orientation.w = pose.orientation.z = 0.0
    assert "quaternion" in node.endpoints.call("teleport", Teleport.Request(pose=pose)).message
    state = node.simulator.vehicle.state
    assert (state.x, state.y, state.yaw, state.speed) == pytest.approx((20.0, -0.5, 0.3, 0.7))
    for _ in range(3):
        before = node.simulator.time_ns
        node.activate()
        patience = Patience(20.0)
        while node.simulator.time_ns == before and patience.is_left():
            time.sleep(0.001)
        node.deactivate()
        assert node.simulator.time_ns > before
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
