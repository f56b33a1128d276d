"""What the stitcher listens to: the cameras of a rig, their depth where they have it, and a LiDAR's cloud."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from sphere_mapping.acquisition.constants import MAX_CLOUD_AGE_S
from sphere_mapping.acquisition.params import SphereStitcherParams
from sphere_mapping.acquisition.range.lens_check import check_info
from sphere_nav.geometry import SE3, Rig
from sphere_nav.geometry.arrays import Bytes, Floats
from sphere_nav.ros import conversions, qos
from sphere_nav.ros.camera.mounting import read_mounting
from sphere_nav.ros.camera.stream import AnyImage, image_topic
from sphere_nav.ros.camera.synchronizer import Instant, Synchronizer
from sphere_nav.ros.endpoints import ERROR, OK, WARN, Endpoints
from sphere_nav.ros.tf import TransformError
from sphere_nav.spheres.sphere import check_depth, check_sphere_image

DEPTH = "/depth"  # a camera's depth is a stream of its own: NAME/depth
NUM_CLOUDS = 8  # kept: at 10 Hz those of 0.8 s, longer than an instant waits for its cameras


class Clouds:
    """Keeps a few of a LiDAR's clouds (N, 3) in the frame of the rig; hands out the one that belongs to an instant."""

    def __init__(self) -> None:
        self._kept: deque[tuple[int, Floats]] = deque(maxlen=NUM_CLOUDS)

    def clear(self) -> None:
        """Forget all: the clock jumped."""
        self._kept.clear()

    def add(self, stamp_ns: int, points: Floats) -> None:
        """Keep a cloud, in place of the oldest."""
        self._kept.append((stamp_ns, points))

    def has_since(self, stamp_ns: int) -> bool:
        """Whether a cloud of this time or later is there: no nearer one can come."""
        return any(stamp >= stamp_ns for stamp, _ in self._kept)

    def at(self, stamp_ns: int) -> Floats | None:
        """Return the cloud nearest in time, None where it is too far away."""
        nearest = min(self._kept, key=lambda cloud: abs(cloud[0] - stamp_ns), default=None)
        return None if nearest is None or abs(nearest[0] - stamp_ns) > 1e9 * MAX_CLOUD_AGE_S else nearest[1]


@dataclass(frozen=True, eq=False)
class RigInstant:
    """What was seen at one instant: images and depth (h, w) in m along the axis by camera; points (N, 3) of the rig."""

    sync: Instant
    images: dict[str, Bytes]
    depths: dict[str, Floats]
    points: Floats | None


class RigIntake:
    """Converts and checks messages; hands the instants that are complete, or late, to `on_instants`, in order.

    now_ns: the node's clock. lookup: T_a_b by the frames a, b and a stamp, TransformError where it is not known.
    """

    def __init__(
        self,
        rig: Rig,
        params: SphereStitcherParams,
        now_ns: Callable[[], int],
        lookup: Callable[[str, str, int], SE3],
        on_instants: Callable[[list[RigInstant]], None],
    ) -> None:
        self.rig, self.params = rig, params
        self._T_rig_lidar = read_mounting(params.cloud.mounting, "cloud.mounting")
        self._now_ns, self._lookup, self._on_instants = now_ns, lookup, on_instants
        self.clouds, self._has_points = Clouds(), True
        self._levels = {name: conversions.Levels() for name in rig.names}
        depths = tuple(name + DEPTH for name in rig.names) if params.has_depth else ()
        is_ready = self.clouds.has_since if params.has_cloud else lambda stamp_ns: True
        waiting = params.sync.slack_s, params.sync.deadline_s
        num_first = params.rectify.num_instants
        self.sync = Synchronizer((*rig.names, *depths), *waiting, is_ready=is_ready, num_first=num_first)

    def subscribe(self, endpoints: Endpoints) -> None:
        """Listen to all cameras; none of them is waited for by name, a cloud is."""
        for name in self.rig.names:
            topic, kind = image_topic(f"cameras/{name}/image_raw", self.params.transport)
            profile = qos.LARGE if kind is Image else qos.SENSOR
            on_image = partial(self._on_image, name)
            images = endpoints.add_subscription(topic, kind, on_image, profile, is_required=False)
            is_rectified = conversions.is_rectified_topic(images.resolved)
            topic, on_info = f"cameras/{name}/camera_info", partial(self._on_info, name, is_rectified)
            endpoints.add_subscription(topic, CameraInfo, on_info, is_required=False)
            if self.params.has_depth:
                topic, on_depth = f"cameras/{name}/depth/image_raw", partial(self._on_depth, name)
                endpoints.add_subscription(topic, Image, on_depth, is_required=False)
        if self.params.has_cloud:
            endpoints.add_subscription("points", PointCloud2, self._on_points)

    def clear(self) -> None:
        """Forget everything with a stamp: the clock jumped."""
        self.sync.clear()
        self.clouds.clear()

    def close_late(self) -> None:
        """Hand out instants whose cameras are late."""
        self._hand_out(self.sync.pop(self._now_ns()))

    def finish(self) -> None:
        """Hand out what is still open: the recording has ended."""
        self._hand_out(self.sync.flush())

    def health(self) -> Iterator[tuple[str, int, str, dict[str, int]]]:
        """Yield what, level, why and numbers for the diagnostics, of every camera and of the cloud."""
        for name, health in self.sync.health.items():
            level = OK if not health.problem else ERROR if health.problem.startswith("frozen") else WARN
            yield f"camera {name}", level, health.problem or "delivers", {"missing": health.num_missing}
        if self.params.has_cloud:
            problem = "" if self._has_points else f"no cloud within {MAX_CLOUD_AGE_S} s of the instant"
            yield "points", WARN if problem else OK, problem or "delivers", {}

    def _on_info(self, name: str, is_rectified: bool, message: CameraInfo) -> None:
        """Refuse a camera whose own calibration is of another size, focal length or lens than the rig's."""
        if message.k[0]:  # 0: not calibrated
            told = conversions.camera_from_info(conversions.as_rectified(message, is_rectified=is_rectified))
            check_info(name, self.rig.camera(name).camera, told)

    def _on_image(self, name: str, message: AnyImage) -> None:
        camera = self.rig.camera(name).camera
        image = conversions.image_to_rgb(message, self._levels[name], (camera.width, camera.height), name)
        check_sphere_image(image, camera, f"{name}: image size")
        self._put(name, message, image)

    def _on_depth(self, name: str, message: Image) -> None:
        depth_m = conversions.depth_to_meters(message)
        check_depth(depth_m, self.rig.camera(name).camera, f"{name}: depth size")
        self._put(name + DEPTH, message, depth_m)

    def _on_points(self, message: PointCloud2) -> None:
        """Keep a cloud, in the frame of the rig."""
        stamp = conversions.stamp_ns(message)
        T_rig_points = self._mount_at(message.header.frame_id, stamp)
        points = conversions.message_to_cloud(message).astype(np.float64)
        self.clouds.add(stamp, T_rig_points.apply(points).astype(np.float32))
        self.close_late()

    def _mount_at(self, frame: str, stamp: int) -> SE3:
        """Return T_rig_points: what /tf says, else the mount of the parameters."""
        rig_frame = self.params.rig_frame
        if frame in ("", rig_frame):
            return SE3.identity()
        try:
            return self._lookup(rig_frame, frame, stamp)
        except TransformError as error:
            if self._T_rig_lidar is None:
                raise ValueError(f"{error}; expected it on /tf or in cloud.mounting, found neither") from None
            return self._T_rig_lidar

    def _put(self, stream: str, message: AnyImage, image: NDArray[Any]) -> None:
        self._hand_out(self.sync.put(stream, conversions.stamp_ns(message), image, self._now_ns()))

    def _hand_out(self, instants: list[Instant]) -> None:
        if instants:
            self._on_instants([self._rig_instant(instant) for instant in instants])

    def _rig_instant(self, instant: Instant) -> RigInstant:
        images = {name: instant.images[name] for name in self.rig.names if name in instant.images}
        depths = {name.removesuffix(DEPTH): plane for name, plane in instant.images.items() if name not in images}
        points = self.clouds.at(instant.stamp_ns) if self.params.has_cloud else None
        self._has_points = points is not None
        return RigInstant(instant, images, depths, points)
