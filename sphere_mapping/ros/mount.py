"""Where cameras are on the vehicle, and where the vehicle is when a map begins: in level axes at the origin of the map.

/tf_static says it, or the parameter `mounting`; a vehicle whose mounts nobody tells is its camera. The frame of a map
is fixed with its first sphere, so a live node waits a moment for what belongs to it: the mount, and an IMU that speaks.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from sensor_msgs.msg import Imu

from sphere_mapping.constants import GRAVITY_S, GROUND_LEAN_RAD, MAX_LEAN_RAD, WAIT_S
from sphere_mapping.level import UP, ImuSample, Upright, find_gravity, find_ground
from sphere_mapping.params import SphereMapperParams
from sphere_nav.geometry import SE3, so3
from sphere_nav.geometry.plausible import check_mounting
from sphere_nav.ros import conversions, qos
from sphere_nav.ros.camera.mounting import read_mounting
from sphere_nav.ros.conversions.poses import imu_attitude
from sphere_nav.ros.endpoints import Endpoints
from sphere_nav.ros.tf import TransformError, TransformListener
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, Sphere

NUM_SAMPLES = 2000  # of an IMU that are kept: a second of the fastest
SAID_NOTHING = (0.0, 0.0, 0.0, 1.0)  # an orientation that drivers send which have none


@dataclass(frozen=True, eq=False)
class CameraMount:
    """A camera on the base: its frame, whether that is optical, its pose in body axes (x ahead, y left, z up).

    T_sphere_body: the same in the axes of its spheres, which are upright on the base where the lens allows it.
    """

    frame_id: str
    is_optical: bool
    T_base_body: SE3
    T_sphere_body: SE3 = field(default_factory=SE3.identity)

    @property
    def T_base_sphere(self) -> SE3:
        """Its spheres on the base."""
        return self.T_base_body @ self.T_sphere_body.inverse()


class VehicleFrame:
    """Looks up mounts, hears the IMU until the map begins, and says where it begins."""

    def __init__(self, endpoints: Endpoints, params: SphereMapperParams, tf: TransformListener, *, is_live: bool):
        self._endpoints, self._params, self._tf, self._is_live = endpoints, params, tf, is_live
        self._mounting = read_mounting(params.mounting)
        self._samples: deque[ImuSample] = deque(maxlen=NUM_SAMPLES)
        self._imu_frame, self._first_ns, self._is_mounted = "", 0, False
        self._imu = endpoints.add_subscription("imu", Imu, self.on_imu, qos.SENSOR, is_required=False)

    def find(self, frame_id: str, is_optical: bool) -> SE3:
        """Return T_base_body of the camera of a frame."""
        self._is_mounted = True
        if self._mounting is not None:
            return self._mounting
        try:
            T_base_frame = self._tf.lookup(self._params.base_frame, frame_id)
        except TransformError as error:
            self._is_mounted, base = False, self._params.base_frame
            self._endpoints.log.warning(f"taking {frame_id} as {base}: {error}", every=30.0, key="mount")
            return SE3.identity()
        check_mounting(T_base_frame.translation, f"{self._params.base_frame} to {frame_id}")
        return T_base_frame @ T_BODY_OPTICAL.inverse() if is_optical else T_base_frame

    def waits(self, stamp_ns: int) -> bool:
        """Whether a live map had better begin a little later: the mount, or the IMU, has not been heard yet."""
        self._first_ns = self._first_ns or stamp_ns
        is_over = not 0 <= stamp_ns - self._first_ns < WAIT_S * 1e9
        if not self._is_live or is_over:
            return False
        has_imu = bool(self._samples) or not self._endpoints.publishers_of("imu")
        return not (self._is_mounted and has_imu)

    def begin(self, sphere: Sphere, mount: CameraMount) -> tuple[SE3, str]:
        """Return T_map_base where the map begins, and what says which way is up; the IMU is not heard any more."""
        self._endpoints.remove_subscription(self._imu)
        is_optical_base = mount.is_optical and mount.frame_id == self._params.base_frame  # against REP 103, but done
        T_base_body = T_BODY_OPTICAL.inverse() if is_optical_base else SE3.identity()
        T_body_sphere = T_base_body.inverse() @ mount.T_base_sphere
        level = self._find_gravity(sphere.stamp_ns, mount, T_base_body)
        if level is None:
            limit = GROUND_LEAN_RAD if self._is_mounted else MAX_LEAN_RAD
            points = T_body_sphere.apply(sphere.points(1)[0])
            level = find_ground(points, T_body_sphere.translation, limit) or Upright(UP)
        return level.T_map_base @ T_base_body.inverse(), level.source

    def on_imu(self, message: Imu) -> None:
        """Keep a sample."""
        stamp_ns = conversions.stamp_ns(message)
        if self._samples and stamp_ns <= self._samples[-1].stamp_ns:
            return
        self._imu_frame = message.header.frame_id
        force, rate = (conversions.point_to_array(v) for v in (message.linear_acceleration, message.angular_velocity))
        try:
            xyzw = imu_attitude(message)
            up = None if tuple(xyzw) == SAID_NOTHING else so3.from_quaternion(xyzw).T @ UP
        except ValueError:
            up = None
        if np.all(np.isfinite([force, rate])) and (up is not None or np.any(force)):
            self._samples.append(ImuSample(stamp_ns, force, rate, up))

    def _find_gravity(self, stamp_ns: int, mount: CameraMount, T_base_body: SE3) -> Upright | None:
        near = [one for one in self._samples if abs(one.stamp_ns - stamp_ns) <= GRAVITY_S * 1e9]
        if not near:
            return None
        try:
            level = find_gravity(near, (T_base_body.inverse() @ self._place(mount)).rotation)
        except TransformError as error:
            self._endpoints.log.warning(f"imu: not used to level the map: {error}")
            return None
        if level is not None and self._is_mounted and level.tilt_rad > MAX_LEAN_RAD:
            lean, most = np.degrees([level.tilt_rad, MAX_LEAN_RAD])
            self._endpoints.log.warning(
                f"imu: not used to level the map: expected {self._params.base_frame} within {most:.0f} deg of upright, "
                f"found {lean:.0f} deg: check the frame of {self._imu_frame}, and the mounting"
            )
            return None
        return level

    def _place(self, mount: CameraMount) -> SE3:
        """Return T_base_imu: as /tf says of the base, else of the camera."""
        base, frame = self._params.base_frame, self._imu_frame
        if frame in ("", base):
            return SE3.identity()
        try:
            return self._tf.lookup(base, frame)
        except TransformError:
            T_base_frame = mount.T_base_body @ T_BODY_OPTICAL if mount.is_optical else mount.T_base_body
            return T_base_frame if frame == mount.frame_id else T_base_frame @ self._tf.lookup(mount.frame_id, frame)
