"""What the stitcher listens to: the cameras of a rig, their depth where they have it, and a LiDAR's cloud."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2

from node_kit import conversions, qos
from node_kit.node import ERROR, OK, WARN, ManagedNode
from node_kit.tf import TransformError, TransformListener
from sphere_geometry import SE3, Rig
from sphere_mapping.acquisition.clouds import Clouds, mount_of
from sphere_mapping.acquisition.params import SphereStitcherParams
from sphere_mapping.acquisition.synchroniser import Instant, Synchroniser

INFO_TOLERANCE = 1e-3  # relative; a camera_info that differs more is of another camera
DEPTH = "/depth"  # a camera's depth is a stream of its own: NAME/depth

OnInstant = Callable[["RigInstant"], None]


@dataclass(frozen=True, eq=False)
class RigInstant:
    """What was seen at one instant: images and depth (h, w) in m along the axis by camera; points (N, 3) of the rig."""

    sync: Instant
    images: dict[str, NDArray[np.uint8]]
    depths: dict[str, NDArray[np.float32]]
    points: NDArray[np.float32] | None


class RigIntake:
    """Subscribes; hands every instant, complete or as the policy has it, to `on_instant`, in order."""

    def __init__(self, node: ManagedNode, rig: Rig, params: SphereStitcherParams, on_instant: OnInstant) -> None:
        self.node, self.rig, self.params, self._on_instant = node, rig, params, on_instant
        depths = tuple(name + DEPTH for name in rig.names) if params.has_depth else ()
        self.sync = Synchroniser((*rig.names, *depths), params.sync)
        self.clouds = Clouds(params.cloud)
        self._waiting: deque[tuple[Instant, int]] = deque()  # for a cloud not older than they are
        is_raw = params.transport == "raw"
        for name in rig.names:
            topic = f"cameras/{name}/image_raw" + ("" if is_raw else "/compressed")
            kind, profile = (Image, qos.LARGE) if is_raw else (CompressedImage, qos.SENSOR)
            node.add_subscription(topic, kind, partial(self._on_image, name), profile, is_required=False)
            node.add_subscription(
                f"cameras/{name}/camera_info", CameraInfo, partial(self._on_info, name), is_required=False
            )
            if params.has_depth:
                node.add_subscription(
                    f"cameras/{name}/depth/image_raw", Image, partial(self._on_depth, name), is_required=False
                )
        if params.has_cloud:
            self._tf = TransformListener(node)
            node.add_subscription("points", PointCloud2, self._on_points)
        node.add_timer(params.sync.deadline_s / 4, self._on_tick)

    def clear(self) -> None:
        """Forget everything with a stamp: the clock jumped."""
        self.sync.clear()
        self.clouds.clear()
        self._waiting.clear()

    def finish(self) -> None:
        """Hand out what is still open: the recording has ended."""
        self._take(self.sync.flush())
        self._hand_out(is_last=True)

    def report_health(self) -> None:
        """Tell the diagnostics about every camera."""
        for name, health in self.sync.health.items():
            level = OK if not health.problem else ERROR if health.problem.startswith("frozen") else WARN
            values = {"images": health.num_images, "missing": health.num_missing, "refused": health.num_refused}
            self.node.report(f"camera {name}", level, health.problem or "delivers", **values)

    def _on_info(self, name: str, message: CameraInfo) -> None:
        """Refuse a camera whose own calibration is of another size or focal length than the rig's."""
        ours = self.rig.camera(name).camera
        self._check_size(name, "size", int(message.width), int(message.height))
        fx = float(ours.coefficients[0])
        if message.k[0] and ours.model != "double_sphere" and abs(message.k[0] - fx) > INFO_TOLERANCE * fx:
            raise ValueError(f"{name}: K[0]: expected {fx:.3f} (rig file), found {message.k[0]:.3f}")

    def _on_image(self, name: str, message: Image | CompressedImage) -> None:
        is_raw = isinstance(message, Image)
        image = conversions.image_to_rgb(message) if is_raw else conversions.compressed_to_array(message)
        self._check_size(name, "image size", image.shape[1], image.shape[0])
        self._take(self.sync.put(name, conversions.stamp_ns(message), image, self.node.now_ns()))

    def _on_depth(self, name: str, message: Image) -> None:
        depth_m = conversions.depth_to_metres(message)
        self._check_size(name, "depth size", depth_m.shape[1], depth_m.shape[0])
        self._take(self.sync.put(name + DEPTH, conversions.stamp_ns(message), depth_m, self.node.now_ns()))

    def _on_points(self, message: PointCloud2) -> None:
        """Keep a cloud, in the frame of the rig."""
        stamp = conversions.stamp_ns(message)
        points = conversions.message_to_cloud(message).astype(np.float64)
        self.clouds.add(stamp, self._mounted(message.header.frame_id, stamp).apply(points).astype(np.float32))
        self._hand_out()

    def _mounted(self, frame: str, stamp: int) -> SE3:
        """Return T_rig_points: what /tf says, else the mount of the parameters."""
        p, rig_frame = self.params.cloud, self.params.rig_frame
        if frame in ("", rig_frame):
            return SE3.identity()
        try:
            return self._tf.lookup(rig_frame, frame, stamp)
        except TransformError as error:
            if not p.has_mount:
                raise ValueError(f"{error}; cloud.has_mount: expected /tf or true, found neither") from None
            return mount_of(p)

    def _on_tick(self) -> None:
        """Close instants whose cameras are late."""
        self._take(self.sync.take(self.node.now_ns()))
        self._hand_out()

    def _take(self, instants: list[Instant]) -> None:
        self._waiting.extend((instant, self.node.now_ns()) for instant in instants)
        self._hand_out()

    def _hand_out(self, *, is_last: bool = False) -> None:
        """Hand out what needs no cloud, has one that is not older, or has waited for it long enough."""
        while self._waiting:
            instant, since = self._waiting[0]
            is_late = self.node.now_ns() - since >= self.params.sync.deadline_s * 1e9
            if self.params.has_cloud and not (self.clouds.has_since(instant.stamp_ns) or is_late or is_last):
                return
            self._waiting.popleft()
            images = {name: instant.images[name] for name in self.rig.names if name in instant.images}
            depths = {name.removesuffix(DEPTH): plane for name, plane in instant.images.items() if name not in images}
            self._on_instant(RigInstant(instant, images, depths, self._cloud_at(instant.stamp_ns)))

    def _cloud_at(self, stamp: int) -> NDArray[np.float32] | None:
        """Return the cloud of an instant."""
        if not self.params.has_cloud:
            return None
        points = self.clouds.at(stamp)
        problem = f"no cloud within {self.params.cloud.max_age_s} s of the instant" if points is None else ""
        self.node.report("points", WARN if problem else OK, problem or "delivers")
        return points

    def _check_size(self, name: str, what: str, width: int, height: int) -> None:
        ours = self.rig.camera(name).camera
        if (width, height) != (ours.width, ours.height):
            expected = f"{ours.width} x {ours.height} (rig file)"
            raise ValueError(f"{name}: {what}: expected {expected}, found {width} x {height}")
