"""What the mapper listens to: spheres, or the images of an RGB-D or of a stereo camera."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.qos import QoSProfile
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from sphere_nav_msgs.msg import AugmentedSphere

from node_kit import conversions, qos
from node_kit.endpoints import COMPRESSED, COMPRESSED_DEPTH
from sphere_geometry import SE3, Camera
from sphere_map.sphere import T_BODY_OPTICAL, Sphere
from sphere_mapping.acquisition.params import SynchroniserParams
from sphere_mapping.acquisition.partial import RgbdView, sphere_from_views
from sphere_mapping.acquisition.synchroniser import Instant, Synchroniser
from sphere_mapping.graph.unrolling import Unroll
from sphere_mapping.params import SphereMapperParams
from sphere_mapping.stereo_intake_node import OnPair, Report, StereoIntake, report_nothing

# The sphere, the frame of its header, whether that is optical, and how to make it anew by the velocity of the camera.
OnSphere = Callable[[Sphere, str, bool, Unroll | None], None]

TOPICS: dict[str, tuple[str, ...]] = {
    "sphere": ("sphere",),
    "rgbd": ("image_raw", "camera_info", "depth/image_raw"),
    "stereo": ("left/image_raw", "left/camera_info", "right/image_raw", "right/camera_info"),
}
DEPTH_INFO = "depth/camera_info"  # only where depth is another camera's than the images
WAIT_S = 1.0  # of stamps, not of a clock: after it an image goes without its counterpart


class Intake:
    """Converts messages by `params.input`; hands every complete instant as a sphere to `on_sphere`.

    `lookup(target, source)` tells T_target_source of two frames, as /tf_static has it, or raises ValueError. `report`
    and `on_pair` are those of a StereoIntake.
    """

    def __init__(
        self,
        params: SphereMapperParams,
        on_sphere: OnSphere,
        lookup: Callable[[str, str], SE3],
        report: Report = report_nothing,
        on_pair: OnPair | None = None,
    ) -> None:
        self._params, self._deliver, self._lookup = params, on_sphere, lookup
        self.stereo = StereoIntake(params.mapper, lookup, report, on_pair)
        self._infos: dict[str, CameraInfo] = {}
        self._frame_id = ""
        streams = [topic for topic in TOPICS[params.input] if topic.endswith("image_raw")]
        self._sync = Synchroniser(streams, SynchroniserParams(slack_s=params.slack_s, deadline_s=WAIT_S, policy="fail"))

    def subscriptions(self) -> Iterator[tuple[str, type[Any], Callable[[Any], None], QoSProfile]]:
        """Yield topic, kind of message, callback and QoS of everything to subscribe."""
        for topic in TOPICS[self._params.input]:
            if topic == "sphere":
                yield topic, AugmentedSphere, self._on_ready_sphere, qos.LARGE
            elif topic.endswith("camera_info"):
                yield topic, CameraInfo, partial(self._infos.__setitem__, topic), qos.SENSOR
            elif self._params.transport == "raw":
                yield topic, Image, partial(self._on_image, topic), qos.SENSOR
            else:
                name = topic + (COMPRESSED_DEPTH if topic.startswith("depth") else COMPRESSED)
                yield name, CompressedImage, partial(self._on_compressed, topic), qos.SENSOR

    def on_depth_info(self, message: CameraInfo) -> None:
        """Remember the camera of depth that is not registered to the images."""
        self._infos[DEPTH_INFO] = message

    def clear(self) -> None:
        """Forget half-complete instants: the clock jumped."""
        self._sync.clear()

    def _on_sphere(self, sphere: Sphere, frame_id: str, is_optical: bool, unroll: Unroll | None = None) -> None:
        if not sphere.measured.any():
            topic = next(name for name in reversed(TOPICS[self._params.input]) if "info" not in name)
            raise ValueError(f"{topic}: range or depth: expected some measured pixels, found none")
        self._deliver(sphere, frame_id, is_optical, unroll)

    def _on_ready_sphere(self, message: AugmentedSphere) -> None:
        self._on_sphere(conversions.message_to_sphere(message), message.header.frame_id, False)

    def _on_compressed(self, topic: str, message: CompressedImage) -> None:
        self._on_image(topic, conversions.decompress(message))

    def _on_image(self, topic: str, message: Image) -> None:
        convert = conversions.depth_to_metres if topic.startswith("depth") else conversions.image_to_rgb
        stamp = conversions.stamp_ns(message)
        if topic == TOPICS[self._params.input][0]:
            self._frame_id = message.header.frame_id
        make = self._rgbd if self._params.input == "rgbd" else self._stereo
        for instant in self._sync.put(topic, stamp, convert(message), stamp):
            if not instant.is_failed and (made := make(instant)) is not None:
                self._on_sphere(*made)

    def _rgbd(self, instant: Instant) -> tuple[Sphere, str, bool, Unroll | None]:
        camera = conversions.camera_from_info(self._info("camera_info"))
        image = self._image_of_size(instant, "image_raw", camera)
        depth_camera, T_image_depth = self._depth_camera(camera)
        depth_m = self._image_of_size(instant, "depth/image_raw", depth_camera)
        is_registered = depth_camera == camera and not np.any(T_image_depth.log())
        beside = {} if is_registered else _beside(depth_camera, T_image_depth)
        view, readout = RgbdView(image, depth_m, camera, **beside), self._params.camera.readout

        def unroll(velocity: NDArray[np.float64]) -> Sphere:
            moving = replace(view, twist=velocity * readout)
            return sphere_from_views([moving], instant.stamp_ns, self._params.mapper.partial)

        sphere = sphere_from_views([view], instant.stamp_ns, self._params.mapper.partial)
        return sphere, self._frame_id, True, unroll if readout else None

    def _depth_camera(self, camera: Camera) -> tuple[Camera, SE3]:
        """Return whose depth it is and where: the images' own camera unless another calibration has come."""
        info = self._infos.get(DEPTH_INFO)
        if info is None:
            return camera, SE3.identity()
        frame_id = info.header.frame_id
        is_beside = frame_id not in ("", self._frame_id)
        T_image_depth = self._lookup(self._frame_id, frame_id) if is_beside else SE3.identity()
        return conversions.camera_from_info(info), T_image_depth

    def _stereo(self, instant: Instant) -> tuple[Sphere, str, bool] | None:
        left, right = (self._info(f"{side}/camera_info") for side in ("left", "right"))
        sphere = self.stereo.make(instant, left, right)
        return None if sphere is None else (sphere, self._frame_id, True)

    def _image_of_size(self, instant: Instant, topic: str, camera: Camera) -> Any:
        """Return an image or depth of the instant, of the camera's size."""
        image = instant.images[topic]
        conversions.check_image_size(camera, image.shape[1], image.shape[0])
        return image

    def _info(self, topic: str) -> CameraInfo:
        if topic not in self._infos:
            raise ValueError(f"{topic}: expected before the first image, found none yet")
        return self._infos[topic]


def _beside(depth_camera: Camera, T_image_depth: SE3) -> dict[str, Any]:
    """Return what a view needs to know of depth that is not registered to its image."""
    return {"depth_camera": depth_camera, "T_sphere_depth": T_BODY_OPTICAL @ T_image_depth}
