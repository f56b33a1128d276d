"""What the mapper listens to: spheres, or the images of an RGB-D or of a stereo camera.

What a camera's driver decides for the mapper.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

from rclpy.qos import QoSProfile
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from sphere_nav_msgs.msg import AugmentedSphere

from sphere_mapping.acquisition.params import SynchroniserParams
from sphere_mapping.acquisition.stitching.synchroniser import Instant, Synchroniser
from sphere_mapping.graph.unrolling import Unroll
from sphere_mapping.params import SphereMapperParams
from sphere_mapping.ros.rgbd_intake import DEPTH_INFO, OnRgbd, RgbdIntake
from sphere_mapping.ros.stereo_intake import OnPair, Report, StereoIntake, report_nothing
from sphere_nav.geometry import SE3
from sphere_nav.ros import conversions, qos
from sphere_nav.ros.camera.drivers import read_driver
from sphere_nav.ros.endpoints import COMPRESSED, COMPRESSED_DEPTH
from sphere_nav.spheres.sphere import Sphere


def with_driver_input(params: SphereMapperParams) -> SphereMapperParams:
    """Return the parameters with the input that the driver gives; ValueError for a driver without range."""
    if not params.driver or params.input != "sphere":
        return params
    driver = read_driver(params.driver)
    if driver.input not in TOPICS:
        raise ValueError(f"driver: expected one with depth or two cameras, found {driver.name}: {driver.title}")
    return replace(params, input=driver.input)


# The sphere, the frame of its header, whether that is optical, and how to make it anew by the velocity of the camera.
OnSphere = Callable[[Sphere, str, bool, Unroll | None], None]

TOPICS: dict[str, tuple[str, ...]] = {
    "sphere": ("sphere",),
    "rgbd": ("image_raw", "camera_info", "depth/image_raw"),
    "stereo": ("left/image_raw", "left/camera_info", "right/image_raw", "right/camera_info"),
}
WAIT_S = 1.0  # of stamps, not of a clock: after it an image goes without its counterpart


class Intake:
    """Converts messages by `params.input`; hands every complete instant as a sphere to `on_sphere`.

    `lookup(target, source)` tells T_target_source of two frames, as /tf_static has it, or raises ValueError. `report`
    and `on_pair` are those of a StereoIntake, `on_rgbd` that of an RgbdIntake.
    """

    def __init__(
        self,
        params: SphereMapperParams,
        on_sphere: OnSphere,
        lookup: Callable[[str, str], SE3],
        report: Report = report_nothing,
        on_pair: OnPair | None = None,
        on_rgbd: OnRgbd | None = None,
    ) -> None:
        self._params, self._deliver, self._lookup = params, on_sphere, lookup
        self.stereo = StereoIntake(params.mapper, lookup, report, on_pair)
        self._rgbd_intake = RgbdIntake(params, lookup, on_rgbd)
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

    def _rgbd(self, instant: Instant) -> tuple[Sphere, str, bool, Unroll | None] | None:
        return self._rgbd_intake.make(instant, self._frame_id, self._info("camera_info"), self._infos.get(DEPTH_INFO))

    def _stereo(self, instant: Instant) -> tuple[Sphere, str, bool] | None:
        left, right = (self._info(f"{side}/camera_info") for side in ("left", "right"))
        sphere = self.stereo.make(instant, left, right)
        return None if sphere is None else (sphere, self._frame_id, True)

    def _info(self, topic: str) -> CameraInfo:
        if topic not in self._infos:
            raise ValueError(f"{topic}: expected before the first image, found none yet")
        return self._infos[topic]
