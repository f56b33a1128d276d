"""What the mapper listens to: spheres, or the images of an RGB-D or of a stereo camera."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from sensor_msgs.msg import CameraInfo
from sphere_nav_msgs.msg import AugmentedSphere

from sphere_mapping.constants import WAIT_S
from sphere_mapping.graph.tracking import Unroll
from sphere_mapping.params import SphereMapperParams
from sphere_mapping.ros.mount import CameraMount
from sphere_mapping.ros.rgbd_intake import DEPTH, DEPTH_INFO, RgbdIntake
from sphere_mapping.ros.stereo_intake import OnPair, Report, StereoIntake, report_nothing
from sphere_nav.geometry import SE3
from sphere_nav.ros import conversions, qos
from sphere_nav.ros.camera.drivers import read_driver
from sphere_nav.ros.camera.stream import AnyImage, image_topic
from sphere_nav.ros.camera.synchronizer import Instant, Synchronizer
from sphere_nav.ros.endpoints import Endpoints
from sphere_nav.spheres.sphere import Sphere


def with_driver_input(params: SphereMapperParams) -> SphereMapperParams:
    """Return the parameters with the input that the driver gives; ValueError for a driver without range."""
    if not params.driver or params.input != "sphere":
        return params
    driver = read_driver(params.driver)
    if driver.input not in TOPICS:
        raise ValueError(f"driver: expected one with depth or two cameras, found {driver.name}: {driver.title}")
    return replace(params, input=driver.input)


# The sphere, where its camera is, and how to make it anew by the velocity of the camera.
OnSphere = Callable[[Sphere, CameraMount, Unroll | None], None]
FindMount = Callable[[str, bool], SE3]
Made = tuple[Sphere, CameraMount, Unroll | None]

TOPICS: dict[str, tuple[str, ...]] = {
    "sphere": ("sphere",),
    "rgbd": ("image_raw", "camera_info", "depth/image_raw"),
    "stereo": ("left/image_raw", "left/camera_info", "right/image_raw", "right/camera_info"),
}


class Intake:
    """Converts messages by `params.input`; hands every complete instant as a sphere to `on_sphere`.

    `lookup(target, source)` tells T_target_source of two frames, as /tf_static has it, or raises ValueError.
    `find_mount(frame, is_optical)` tells T_base_body of the camera of a frame; without it the camera is the base.
    `report` and `on_pair` are those of a StereoIntake.
    """

    def __init__(
        self,
        params: SphereMapperParams,
        on_sphere: OnSphere,
        lookup: Callable[[str, str], SE3],
        report: Report = report_nothing,
        on_pair: OnPair | None = None,
        find_mount: FindMount = lambda frame_id, is_optical: SE3.identity(),
    ) -> None:
        self._params, self._deliver, self._find_mount = params, on_sphere, find_mount
        self.stereo = StereoIntake(params.mapper, lookup, report, on_pair)
        self._rgbd_intake = RgbdIntake(params, lookup)
        self._infos: dict[str, CameraInfo] = {}
        self._is_rectified: dict[str, bool] = {}  # the images of a calibration
        self._frame_id = ""
        streams = [topic for topic in TOPICS[params.input] if topic.endswith("image_raw")]
        self._levels = {topic: conversions.Levels() for topic in streams}
        self._sync = Synchronizer(streams, params.slack_s, WAIT_S)

    def subscribe(self, endpoints: Endpoints) -> None:
        """Listen to what the input is made of."""
        for topic in TOPICS[self._params.input]:
            if topic == "sphere":
                endpoints.add_subscription(topic, AugmentedSphere, self._on_ready_sphere, qos.LARGE)
            elif topic.endswith("camera_info"):
                endpoints.add_subscription(topic, CameraInfo, partial(self._infos.__setitem__, topic))
            else:
                name, kind = image_topic(topic, self._params.transport, is_depth=topic == DEPTH)
                images = endpoints.add_subscription(name, kind, partial(self._on_image, topic))
                info = topic.replace("image_raw", "camera_info")
                self._is_rectified[info] = conversions.is_rectified_topic(images.resolved)
        if self._params.input == "rgbd":
            on_depth_info = partial(self._infos.__setitem__, DEPTH_INFO)
            endpoints.add_subscription(DEPTH_INFO, CameraInfo, on_depth_info, is_required=False)

    def clear(self) -> None:
        """Forget half-complete instants: the clock jumped."""
        self._sync.clear()

    def _on_sphere(self, sphere: Sphere, mount: CameraMount, unroll: Unroll | None = None) -> None:
        if not sphere.measured.any():
            topic = next(name for name in reversed(TOPICS[self._params.input]) if "info" not in name)
            raise ValueError(f"{topic}: range or depth: expected some measured pixels, found none")
        self._deliver(sphere, mount, unroll)

    def _on_ready_sphere(self, message: AugmentedSphere) -> None:
        self._on_sphere(conversions.message_to_sphere(message), self._mount(message.header.frame_id, is_optical=False))

    def _on_image(self, topic: str, message: AnyImage) -> None:
        stamp = conversions.stamp_ns(message)
        is_depth, levels = topic == DEPTH, self._levels[topic]
        pixels = conversions.depth_to_meters(message) if is_depth else conversions.image_to_rgb(message, levels)
        if topic == TOPICS[self._params.input][0]:
            self._frame_id = message.header.frame_id
        make = self._rgbd if self._params.input == "rgbd" else self._stereo
        for instant in self._sync.put(topic, stamp, pixels, stamp):
            if not instant.notes and (made := make(instant)) is not None:
                self._on_sphere(*made)

    def _rgbd(self, instant: Instant) -> Made | None:
        mount = self._mount(self._frame_id, is_optical=True)
        depth_info = self._info(DEPTH_INFO) if DEPTH_INFO in self._infos else None
        return self._rgbd_intake.make(instant, mount, self._info("camera_info"), depth_info)

    def _stereo(self, instant: Instant) -> Made | None:
        left, right = (self._info(f"{side}/camera_info") for side in ("left", "right"))
        return self.stereo.make(instant, self._mount(self._frame_id, is_optical=True), left, right)

    def _mount(self, frame_id: str, *, is_optical: bool) -> CameraMount:
        return CameraMount(frame_id, is_optical, self._find_mount(frame_id, is_optical))

    def _info(self, topic: str) -> CameraInfo:
        if topic not in self._infos:
            raise ValueError(f"{topic}: expected before the first image, found none yet")
        return conversions.as_rectified(self._infos[topic], is_rectified=self._is_rectified[topic])
