"""What the mapper listens to: spheres, or the images of an RGB-D or of a rectified stereo camera."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from sensor_msgs.msg import CameraInfo, Image
from sphere_nav_msgs.msg import AugmentedSphere

from node_kit import conversions, qos
from node_kit.node import ManagedNode
from sphere_geometry import Camera, Pinhole
from sphere_map.sphere import T_BODY_OPTICAL, Sphere
from sphere_mapping.acquisition.pairing import Pairing
from sphere_mapping.acquisition.partial import sphere_from_rgbd
from sphere_mapping.acquisition.stereo import sphere_from_stereo
from sphere_mapping.params import SphereMapperParams

OnSphere = Callable[[Sphere, str, bool], None]  # the sphere, the frame of its header, whether that is optical

TOPICS: dict[str, tuple[str, ...]] = {
    "sphere": ("sphere",),
    "rgbd": ("image_raw", "camera_info", "depth/image_raw"),
    "stereo": ("left/image_raw", "left/camera_info", "right/image_raw", "right/camera_info"),
}


class Intake:
    """Subscribes by `params.input`; hands every complete instant as a sphere to `on_sphere`."""

    def __init__(self, node: ManagedNode, params: SphereMapperParams, on_sphere: OnSphere) -> None:
        self._params, self._deliver = params, on_sphere
        self._infos: dict[str, CameraInfo] = {}
        streams = [topic for topic in TOPICS[params.input] if topic.endswith("image_raw")]
        self.pairing: Pairing[Image] = Pairing(streams, round(params.slack_s * 1e9))
        if params.input == "sphere":
            node.add_subscription("sphere", AugmentedSphere, self._on_ready_sphere, qos.LARGE)
            return
        for topic in TOPICS[params.input]:
            if topic.endswith("camera_info"):
                node.add_subscription(topic, CameraInfo, partial(self._infos.__setitem__, topic), qos.SENSOR)
            else:
                node.add_subscription(topic, Image, partial(self._on_image, topic), qos.SENSOR)

    def _on_sphere(self, sphere: Sphere, frame_id: str, is_optical: bool) -> None:
        if not sphere.measured.any():
            topic = next(name for name in reversed(TOPICS[self._params.input]) if "info" not in name)
            raise ValueError(f"{topic}: range or depth: expected some measured pixels, found none")
        self._deliver(sphere, frame_id, is_optical)

    def clear(self) -> None:
        """Forget half-complete instants: the clock jumped."""
        self.pairing.clear()

    def _on_ready_sphere(self, message: AugmentedSphere) -> None:
        self._on_sphere(conversions.message_to_sphere(message), message.header.frame_id, False)

    def _on_image(self, topic: str, message: Image) -> None:
        complete = self.pairing.put(topic, conversions.stamp_ns(message), message)
        if complete is None:
            return
        stamp, images = complete
        make = self._rgbd if self._params.input == "rgbd" else self._stereo
        frame_id = next(iter(images.values())).header.frame_id
        self._on_sphere(make(stamp, images), frame_id, True)

    def _rgbd(self, stamp: int, images: dict[str, Image]) -> Sphere:
        camera = conversions.camera_from_info(self._info("camera_info"))
        image = self._image(images, "image_raw", camera)
        depth_m = conversions.depth_to_metres(images["depth/image_raw"])
        conversions.check_image_size(camera, depth_m.shape[1], depth_m.shape[0])
        return sphere_from_rgbd(image, depth_m, camera, T_BODY_OPTICAL, stamp, self._params.mapper.partial)

    def _stereo(self, stamp: int, images: dict[str, Image]) -> Sphere:
        right_info = self._info("right/camera_info")
        camera = conversions.camera_from_info(self._info("left/camera_info"), is_rectified=True)
        right = conversions.camera_from_info(right_info, is_rectified=True)
        baseline_m = conversions.stereo_baseline(right_info)
        if not isinstance(camera, Pinhole):
            raise ValueError(f"left/camera_info: expected a rectified pinhole camera, found {camera.model}")
        left_image = self._image(images, "left/image_raw", camera)
        right_image = self._image(images, "right/image_raw", right)
        params = self._params.mapper
        return sphere_from_stereo(
            left_image, right_image, camera, baseline_m, T_BODY_OPTICAL, stamp, params.stereo, params.partial
        )

    def _image(self, images: dict[str, Image], topic: str, camera: Camera) -> Any:
        image = conversions.image_to_rgb(images[topic])
        conversions.check_image_size(camera, image.shape[1], image.shape[0])
        return image

    def _info(self, topic: str) -> CameraInfo:
        if topic not in self._infos:
            raise ValueError(f"{topic}: expected before the first image, found none yet")
        return self._infos[topic]
