"""A camera with depth beside it: each image goes on with the depth of its instant, or without where none came."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from sensor_msgs.msg import CameraInfo

from sphere_nav.geometry import SE3, Camera
from sphere_nav.localization.params import NodeParams
from sphere_nav.localization.status import Finding
from sphere_nav.ros import conversions, qos
from sphere_nav.ros.camera.images import AnyImage, image_topic, read_depth
from sphere_nav.ros.camera.intake import CameraIntake
from sphere_nav.ros.camera.stream import Picture
from sphere_nav.ros.camera.synchronizer import Instant, Synchronizer
from sphere_nav.ros.constants import DEPTH_SLACK_S
from sphere_nav.ros.endpoints import Endpoints
from sphere_nav.spheres.range_alignment import DepthImage

IMAGE, DEPTH, DEPTH_INFO = "image_raw", "depth/image_raw", "depth/camera_info"


class DepthCameraIntake(CameraIntake):
    """Hands on every image of one camera; an image waits for its depth until the next one comes.

    Depth is of the image's camera where it has no calibration of its own, else of one beside it by /tf_static.
    """

    def __init__(
        self,
        endpoints: Endpoints,
        params: NodeParams,
        on_picture: Callable[[Picture], None],
        on_refusal: Callable[[int, Finding], None],
        *,
        has_sphere_info: bool = False,
    ) -> None:
        """As of a camera without depth."""
        self._on_picture = on_picture
        self._depth_info: CameraInfo | None = None
        self._synchronizer = Synchronizer((IMAGE, DEPTH), DEPTH_SLACK_S)
        super().__init__(endpoints, params, self._on_image, on_refusal, has_sphere_info=has_sphere_info)
        profile = qos.DEEP if params.every_image else qos.SENSOR
        endpoints.add_subscription(DEPTH_INFO, CameraInfo, self._on_info, profile, is_required=False)
        topic, kind = image_topic(DEPTH, params.transport, is_depth=True)
        endpoints.add_subscription(topic, kind, self._on_depth, profile)

    def clear(self) -> None:
        """Forget what has a stamp: the clock jumped."""
        super().clear()
        self._synchronizer.clear()

    def _on_info(self, message: CameraInfo) -> None:
        self._depth_info = message

    def _on_image(self, picture: Picture) -> None:
        self._put(IMAGE, picture.stamp_ns, picture)

    def _on_depth(self, message: AnyImage) -> None:
        self._put(DEPTH, conversions.stamp_ns(message), message)

    def _put(self, topic: str, stamp_ns: int, what: Picture | AnyImage) -> None:
        for instant in self._synchronizer.put(topic, stamp_ns, what):
            self._hand_on(instant)

    def _hand_on(self, instant: Instant) -> None:
        """Hand an image on with its depth; ValueError for depth that cannot be used, after the image has gone on."""
        picture: Picture | None = instant.images.get(IMAGE)
        message: AnyImage | None = instant.images.get(DEPTH)
        if picture is None:
            return
        try:
            depth = self._convert(message, picture.camera) if message is not None else None
        except ValueError:
            self._on_picture(picture)
            raise
        self._on_picture(replace(picture, depth=depth))

    def _convert(self, message: AnyImage, camera: Camera) -> DepthImage:
        depth_m, info, T_image_depth = read_depth(message), self._depth_info, SE3.identity()
        if info is not None:
            camera = conversions.camera_from_info(info, is_rectified=self._params.is_rectified)
            T_image_depth = self.find_pose(info.header.frame_id or message.header.frame_id)
        conversions.check_image_size(camera, depth_m.shape[1], depth_m.shape[0])
        return DepthImage(depth_m, camera, T_image_depth)
