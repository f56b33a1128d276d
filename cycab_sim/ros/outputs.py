"""What the simulator publishes: each output of `Simulator.take_due` as messages of the present instant."""

from __future__ import annotations

import heapq
from typing import Any

import numpy as np
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CameraInfo, Image, Imu, LaserScan
from sphere_nav_msgs.msg import AugmentedSphere, SphereInfo
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from cycab_sim.sensors.cameras import FRAME, rig_place
from cycab_sim.sensors.faults import SECOND
from cycab_sim.sensors.imaging import RenderedFrame
from cycab_sim.simulator import Simulator
from sphere_nav.geometry import Spherical
from sphere_nav.geometry.files.rig_file import rig_text, write_rig
from sphere_nav.ros import conversions, qos
from sphere_nav.ros.endpoints import Endpoints, Publisher

WORLD, ODOM, BASE, IMU, SCAN = "world", "odom", "base_link", "imu_link", "scan_link"


class Outputs:
    """The topics of a simulator; `publish(name)` sends one output, later where a fault delays it."""

    def __init__(self, endpoints: Endpoints, simulator: Simulator) -> None:
        self.simulator, add = simulator, endpoints.add_publisher
        self._late: list[tuple[int, int, str, Publisher, Any]] = []
        self._num_late = 0
        self.tf = add("/tf", TFMessage, qos.TF)
        is_sphere = isinstance(simulator.mounts["camera"].camera, Spherical)
        self.image = add("image_raw", Image, qos.LARGE)
        self.info = add(*(("sphere_info", SphereInfo) if is_sphere else ("camera_info", CameraInfo)))
        self.sphere = add("sphere", AugmentedSphere, qos.LARGE)
        self.odom = add("odom", Odometry)
        self.truth = add("ground_truth/odometry", Odometry)
        self.tf_static = add("/tf_static", TFMessage, qos.TF_STATIC)
        self.rig_images = {n: add(f"cameras/{n}/image_raw", Image, qos.LARGE) for n in simulator.rig_names}
        self.rig_infos = {n: add(f"cameras/{n}/camera_info", CameraInfo) for n in simulator.rig_names}
        if simulator.params.imu.is_on:
            self.imu = add("imu", Imu)
        if simulator.params.scan.is_on:
            self.scan = add("scan", LaserScan)
        if simulator.rig is not None:
            self.description = add("rig_description", String, qos.LATCHED)

    @property
    def images(self) -> dict[str, Publisher]:
        """What must be seen by somebody, by its topic: the image that is answered, or the images that are recorded."""
        if self.simulator.params.mode == "drive":
            return {"image_raw": self.image}
        return {f"cameras/{name}/image_raw": one for name, one in self.rig_images.items()}

    def publish_statics(self) -> None:
        """Send what does not change: where everything is mounted, and the rig file."""
        simulator, now = self.simulator, self.simulator.time_ns
        places = [(mount.T_base_camera, mount.frame_id) for mount in simulator.mounts.values()]
        if simulator.rig is not None:
            places.append((rig_place(simulator.params.rig), FRAME))
            self.description.publish(String(data=rig_text(simulator.rig)))
            if simulator.params.rig.file:
                write_rig(simulator.params.rig.file, simulator.rig)
        if simulator.params.imu.is_on:
            places.append((simulator.imu.T_base_imu, IMU))
        if simulator.params.scan.is_on:
            places.append((simulator.scanner.T_base_scan, SCAN))
        transforms = [conversions.se3_to_transform(T, now, BASE, frame_id) for T, frame_id in places]
        self.tf_static.publish(TFMessage(transforms=transforms))

    def publish(self, name: str) -> int | None:
        """Send one output; return the stamp of the driving camera's image if it was sent."""
        is_image = name == "camera" and not self._delay_ns(name)
        getattr(self, f"_publish_{name}")(self.simulator.time_ns)
        return self.simulator.time_ns if is_image else None

    def publish_late(self) -> int | None:
        """Send what was delayed until now; return the stamp of the last image of the driving camera among it."""
        stamp = None
        while self._late and self._late[0][0] <= self.simulator.time_ns:
            _, _, name, publisher, message = heapq.heappop(self._late)
            publisher.publish(message)
            if name == "camera" and isinstance(message, Image):
                stamp = conversions.stamp_ns(message)
        return stamp

    def _send(self, name: str, publisher: Publisher, message: Any) -> None:
        delay = self._delay_ns(name)
        if delay == 0:
            publisher.publish(message)
            return
        self._num_late += 1  # keeps the order of messages that are due together
        heapq.heappush(self._late, (self.simulator.time_ns + delay, self._num_late, name, publisher, message))

    def _delay_ns(self, name: str) -> int:
        return round((self.simulator.faults.magnitude(name, "delayed", self.simulator.time_ns) or 0.0) * SECOND)

    def _publish_camera(self, now: int) -> None:
        self._send_image("camera", self.simulator.capture("camera"), self.info, self.image)

    def _publish_sphere(self, now: int) -> None:
        frame: Any = self.simulator.capture("sphere")  # has the fields of a Sphere
        message = conversions.sphere_to_message(frame, self.simulator.mounts["sphere"].frame_id)
        self._send("sphere", self.sphere, message)

    def _publish_rig(self, now: int) -> None:
        for name, frame in self.simulator.capture_rig().items():
            self._send_image(name, frame, self.rig_infos[name], self.rig_images[name])

    def _send_image(self, name: str, frame: RenderedFrame, info: Publisher, image: Publisher) -> None:
        """Send what a camera is like, and its image, grey or in colours."""
        frame_id, camera = self.simulator.mounts[name].frame_id, frame.camera
        if isinstance(camera, Spherical):
            self._send(name, info, conversions.camera_to_sphere_info(camera, frame_id))
        else:
            self._send(name, info, conversions.camera_to_info(camera, frame.stamp_ns, frame_id))
        encoding = "mono8" if frame.image.ndim == 2 else "rgb8"
        self._send(name, image, conversions.array_to_image(frame.image, frame.stamp_ns, frame_id, encoding))

    def _publish_imu(self, now: int) -> None:
        reading, p = self.simulator.read_imu(), self.simulator.imu.errors
        message = Imu(header=conversions.header(now, IMU))
        message.orientation = conversions.se3_to_pose(reading.T_world_imu).orientation
        _set_xyz(message.linear_acceleration, reading.acceleration)
        _set_xyz(message.angular_velocity, reading.angular_rate)
        message.orientation_covariance = np.eye(3).ravel() * np.radians(p.orientation_noise_deg) ** 2
        message.linear_acceleration_covariance = np.eye(3).ravel() * p.acceleration_noise**2
        message.angular_velocity_covariance = np.eye(3).ravel() * p.rate_noise**2
        self._send("imu", self.imu, message)

    def _publish_scan(self, now: int) -> None:
        angles, p = self.simulator.scanner.angles, self.simulator.scanner.model
        message = LaserScan(header=conversions.header(now, SCAN), ranges=self.simulator.scan().tolist())
        message.angle_min, message.angle_max = float(angles[0]), float(angles[-1])
        message.angle_increment, message.scan_time = float(angles[1] - angles[0]), self.simulator.params.scan.period
        message.range_min, message.range_max = p.min_range, p.max_range
        self._send("scan", self.scan, message)

    def _publish_odom(self, now: int) -> None:
        measured, vehicle = self.simulator.odometry, self.simulator.vehicle
        wheels = np.array([measured.speed, 0.0, 0.0, 0.0, 0.0, measured.yaw_rate])
        deviations = np.diag(np.square(measured.deviations))
        message = conversions.se3_to_odometry(measured.T_odom_base, deviations, now, (ODOM, BASE), wheels)
        self._send("odom", self.odom, message)
        transform = conversions.se3_to_transform(measured.T_odom_base, now, ODOM, BASE)
        self._send("odom", self.tf, TFMessage(transforms=[transform]))
        twist = np.array([vehicle.state.speed, 0.0, 0.0, 0.0, 0.0, vehicle.yaw_rate])
        T_world_base = self.simulator.T_world_base
        self.truth.publish(conversions.se3_to_odometry(T_world_base, np.zeros((6, 6)), now, (WORLD, BASE), twist))


def _set_xyz(vector: Any, values: np.ndarray) -> None:
    vector.x, vector.y, vector.z = map(float, values)
