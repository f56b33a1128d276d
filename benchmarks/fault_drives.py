"""A drive by images in one process: simulated street and car, `dense_localizer` and `path_follower` on a bus.

Time is simulated and stamped, so that a drive does not depend on the speed of the machine; no DDS. The map is of ideal
spheres 1.5 m apart; the camera gives 10 images a second, which arrive 50 ms later.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from sphere_nav_msgs.msg import LocalizationStatus
from tf2_msgs.msg import TFMessage

from benchmarks.room import graph_of, motions
from cycab_sim.params import ActuatorParams, CarParams, SimParams
from cycab_sim.simulator import Simulator
from cycab_sim.vehicle import Vehicle, VehicleCommand, VehicleState, WheelErrors, WheelOdometry
from dense_localizer.ros.node import DenseLocalizerNode
from path_follower.ros.node import PathFollowerNode
from sphere_nav.estimation.least_squares import gate, squared_distance
from sphere_nav.geometry import SE3
from sphere_nav.params import build
from sphere_nav.ros import conversions
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.maps.reader import MapDetails, save_map
from sphere_nav.spheres.graph import SphereGraph

SECOND, STEP_NS, PERIOD_NS, LATENCY_NS, ODOM_NS = 1_000_000_000, 10_000_000, 100_000_000, 50_000_000, 20_000_000
STREET = {"path": "straight", "camera.size": "320,240", "sphere.width": 768, "render.supersampling": 1}
SPACING = 1.5  # m between key spheres
BEFORE = 2.0  # m of map behind the place where drives begin
NOISE = 1.2  # grey levels
FRAME = "camera_optical"
EXACT = WheelErrors(0.0, 1.0, 0.0, 0.0, 0.0)
Messages = list[tuple[str, Any]]  # topic and message


class Course:
    """A street with its map, and what was drawn of it already."""

    def __init__(self, folder: Path, seed: int = 1) -> None:
        self.simulator = Simulator(build(SimParams, STREET | {"seed": seed}))
        self.path = self.simulator.path
        mount, sphere = self.simulator.mounts["camera"], cast("Any", self.simulator.mounts["sphere"])
        self.camera, self.T_base_camera = mount.camera, mount.T_base_camera
        self.length = self.path.length - BEFORE
        along = np.arange(-BEFORE, self.length, SPACING)
        poses = [SE3.from_planar(*self.pose(float(one))) @ sphere.T_base_camera for one in along]
        nodes = list(graph_of(self.simulator, sphere.camera, poses, SECOND))
        self.map = save_map(folder / "map", SphereGraph(nodes, motions(nodes)), MapDetails("street"))

    def pose(self, along: float) -> tuple[float, float, float]:
        """Return x, y, yaw of the base at a distance along the path."""
        x, y, yaw, _ = map(float, self.path.at(along + BEFORE))
        return x, y, yaw

    def look(self, x: float, y: float, yaw: float) -> NDArray[np.uint8]:
        """Return what the camera sees, without noise."""
        T_world_camera = SE3.from_planar(x, y, yaw) @ self.T_base_camera
        return self.simulator.render(self.camera, T_world_camera, is_gray=True)[0]


@dataclass
class Gauge:
    """What a drive has shown: commands (time, speed), stops, the way driven and the largest distance from the path.

    placed: when images were taken that the map has placed, as near to the truth as their covariances say.
    """

    commands: list[tuple[int, float]]
    num_stops: int = 0
    way: float = 0.0
    aside: float = 0.0
    placed: list[int] = field(default_factory=list)


class Drive:
    """One drive along a course; faults change `images`, called with every image and what belongs to it."""

    def __init__(self, course: Course, seed: int, *, has_odometry: bool = False) -> None:
        self.course, self.seed, self.has_odometry = course, seed, has_odometry
        self.rng = np.random.default_rng(seed)
        self.bus = OfflineBus()
        self.localizer: Any = self.bus.add(DenseLocalizerNode, {"map": str(course.map), "every_image": True})
        self.localizer.residual = SimpleNamespace(num_subscriptions=0)  # nobody looks at it
        self.follower: Any = self.bus.add(PathFollowerNode, {"enable_stamped_cmd_vel": True})
        self.vehicle = Vehicle(VehicleState(*course.pose(0.0)), CarParams(), ActuatorParams())
        self.command, self.now, self.num_images = VehicleCommand(), SECOND, 0
        self._T_map_taken: dict[int, SE3] = {}  # where the base was at the stamps of images
        self._told: PoseWithCovarianceStamped | None = None
        self.odometry = Odometer(ODOM_NS / SECOND, seed, EXACT)
        self.images: Callable[[Messages], Messages] | None = None
        self.latency_ns = LATENCY_NS
        self.pending: list[tuple[int, str, Any]] = []
        self.gauge = Gauge([])
        path = [(0, SE3.from_planar(*course.pose(float(s)))) for s in np.arange(0.0, course.length - 1.0, 0.5)]
        list(self.bus.advance(self.now))
        mount = conversions.se3_to_transform(course.T_base_camera, self.now, "base_link", FRAME)
        self.bus.deliver("/tf_static", TFMessage(transforms=[mount]))
        self.bus.deliver("/reference_path", conversions.poses_to_path(path, self.now, "map"))

    def start(self) -> str:
        """Arm; return why not."""
        answer = self.follower.endpoints.call("start")
        return "" if answer.success else str(answer.message).partition(":")[0]

    def teleport(self, along: float, turned: float = 0.0) -> None:
        """Put the car elsewhere on the course, at its speed, so much further along it."""
        x, y, yaw = self.course.pose(self.place[0] + along)
        self.vehicle.state = VehicleState(x, y, yaw + turned, self.vehicle.state.speed, 0.0)

    @property
    def place(self) -> tuple[float, float]:
        """Where the car is along the straight path, and beside it, m."""
        T_start_car = SE3.from_planar(*self.course.pose(0.0)).inverse() @ self.vehicle.state.T_world_base
        x, y, _ = T_start_car.translation.tolist()
        return x, y

    def run(self, seconds: float) -> None:
        """Let time pass."""
        end = self.now + round(seconds * SECOND)
        while self.now < end:
            self._sense()
            said = list(self.bus.advance(self.now))
            due = [item for item in self.pending if item[0] <= self.now]
            self.pending = [item for item in self.pending if item[0] > self.now]
            for _, topic, message in due:
                self.bus.deliver(topic, message)
                said += self.bus.settle()
            for item in said:
                if item.topic == "/cmd_vel":
                    self._obey(item.message.twist)
                elif item.topic == "/pose":
                    self._told = item.message
                elif item.topic == "/status":
                    self._judge(item.message)
            self._move()
            self.now += STEP_NS

    def _sense(self) -> None:
        if self.now % PERIOD_NS == 0:
            self.num_images += 1
            messages = self.see()
            messages = messages if self.images is None else self.images(messages)
            self.pending += [(self.now + self.latency_ns, *item) for item in messages]
        if self.has_odometry and self.now % ODOM_NS == 0 and not self.odometry.is_silent:
            self.pending.append((self.now, "/odom", self.odometry.message(self.now)))

    def see(self) -> Messages:
        """Return an image of now with its calibration."""
        state = self.vehicle.state
        self._T_map_taken[self.now] = state.T_world_base
        view = self.course.look(state.x, state.y, state.yaw)
        noise = np.random.default_rng([self.seed, self.num_images]).normal(0.0, NOISE, view.shape)
        image = np.clip(np.rint(view + noise), 0, 255).astype(np.uint8)
        info = conversions.camera_to_info(self.course.camera, self.now, FRAME)
        return [("/camera_info", info), ("/image_raw", conversions.array_to_image(image, self.now, FRAME, "mono8"))]

    def _obey(self, twist: Any) -> None:
        speed = float(twist.linear.x)
        self.gauge.num_stops += speed == 0.0 and self.command.speed != 0.0
        self.command = VehicleCommand(speed, float(twist.angular.z))
        self.gauge.commands.append((self.now, speed))

    def _judge(self, status: LocalizationStatus) -> None:
        """Note the image of a status if the map, not the images before it, has placed it where it was."""
        stamp = conversions.stamp_ns(status)
        if status.age or self._told is None or conversions.stamp_ns(self._told) != stamp:
            return
        T_map_base, covariance = conversions.pose_with_covariance_to_se3(self._told)
        truth = self._T_map_taken.get(stamp) if covariance.any() else None
        if truth is not None and squared_distance(T_map_base, truth, covariance) <= gate(6):
            self.gauge.placed.append(stamp)

    def _move(self) -> None:
        self.vehicle.step(self.command, STEP_NS / SECOND)
        self.odometry.follow(self.vehicle, STEP_NS / SECOND)
        self.gauge.way += abs(self.vehicle.state.speed) * STEP_NS / SECOND
        self.gauge.aside = max(self.gauge.aside, abs(self.place[1]))


class Odometer(WheelOdometry):
    """Wheel odometry; a fault sets `factor` (of its motion), `is_silent` or `is_frozen` (its last message goes on)."""

    factor, is_frozen, is_silent = 1.0, False, False

    def follow(self, vehicle: Vehicle, seconds: float) -> None:
        """Follow the wheels."""
        if not self.is_frozen:
            self.step(self.factor * vehicle.state.speed, self.factor * vehicle.yaw_rate, seconds)

    def message(self, now: int) -> Odometry:
        """Return what is published now."""
        twist = np.array([self.speed, 0.0, 0.0, 0.0, 0.0, self.yaw_rate])
        return conversions.se3_to_odometry(self.T_odom_base, 1e-4 * np.eye(6), now, ("odom", "base_link"), twist)
