"""Images with all they need to be localised: calibration, the camera's place on the base, odometry."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from sphere_nav_msgs.msg import SphereInfo

from localization.params import NodeParams
from localization.status import FINE, Finding, Reason
from node_kit import conversions, qos
from node_kit.arrival import MAX_AHEAD_NS, ahead_s
from node_kit.endpoints import Endpoints
from node_kit.mounting import read_mounting
from node_kit.odometry_input import OdometryInput
from node_kit.tf import TransformListener
from sphere_geometry import SE3, Camera
from sphere_map.sphere import T_BODY_OPTICAL

DEEP = qos.QoSProfile(depth=1000, reliability=qos.RELIABLE, durability=qos.VOLATILE)
ENCODINGS = "publish a usual encoding: mono8, mono16, rgb8, bgr8, rgba8, bgra8, or a PNG or JPEG"

AnyImage: TypeAlias = Image | CompressedImage


@dataclass(frozen=True)
class Picture:
    """One image with what belongs to it."""

    image: NDArray[Any]  # grey (H, W)
    camera: Camera
    stamp_ns: int
    T_base_camera: SE3  # optical axes
    T_odom_base: SE3 | None


class CameraIntake:
    """Subscribes; hands every image on, in order, as a `Picture` or with what is wrong with it."""

    def __init__(
        self,
        endpoints: Endpoints,
        params: NodeParams,
        on_picture: Callable[[Picture], None],
        on_refusal: Callable[[int, Finding], None],
        *,
        has_sphere_info: bool = False,
    ) -> None:
        """`on_refusal(stamp_ns, finding)` gets the images that cannot be used; `has_sphere_info` allows panoramas."""
        self._endpoints, self._params = endpoints, params
        self._on_picture, self._on_refusal = on_picture, on_refusal
        self._waiting: deque[AnyImage] = deque()
        self._tf = TransformListener(endpoints, ignored=params.map_frame)
        self._mounting = read_mounting(params.mounting)
        self.odometry = OdometryInput(endpoints, self._tf.tree, params.base_frame, is_used=params.use_odometry)
        self.forget_camera()
        profile = DEEP if params.every_image else qos.SENSOR
        endpoints.add_subscription(
            "camera_info", CameraInfo, self._on_camera_info, profile, is_required=not has_sphere_info
        )
        if has_sphere_info:
            endpoints.add_subscription("sphere_info", SphereInfo, self._on_sphere_info, profile, is_required=False)
        is_raw = params.transport == "raw"
        topic, kind = ("image_raw", Image) if is_raw else ("image_raw/compressed", CompressedImage)
        self.images = endpoints.add_subscription(topic, kind, self._on_image, profile)

    def clear(self) -> None:
        """Forget what has a stamp: the clock jumped."""
        self.odometry.clear()
        self._tf.tree.clear()
        self._waiting.clear()

    def forget_camera(self) -> None:
        """Accept the next calibration, frames and odometry as new ones."""
        self.camera: Camera | None = None
        self._T_base_camera: SE3 | None = None
        self._fault = Finding(Reason.BAD_INFO, detail="no camera_info yet")
        self._is_refused = False  # the calibration that came
        self._image_frame = self._info_frame = ""
        self.odometry.reset()

    @property
    def is_mounted(self) -> bool:
        """Whether it is known where the camera is on the base."""
        return self._T_base_camera is not None

    @property
    def T_base_camera(self) -> SE3:
        """The camera on the base, optical axes; identity before it is known."""
        return self._T_base_camera or SE3.identity()

    def _on_camera_info(self, message: CameraInfo) -> None:
        is_rectified = self._params.is_rectified
        self._on_info(message.header.frame_id, lambda: conversions.camera_from_info(message, is_rectified=is_rectified))

    def _on_sphere_info(self, message: SphereInfo) -> None:
        self._on_info(message.frame_id, lambda: conversions.sphere_info_to_camera(message))

    def _on_info(self, frame: str, convert: Callable[[], Camera]) -> None:
        try:
            self._info_frame = _same_frame("camera_info", self._info_frame, frame)
            self.camera, self._is_refused = convert(), False
        except ValueError as error:
            self.camera, self._is_refused = None, True
            self._fault = Finding(Reason.BAD_INFO, detail=str(error))
            self._hand_on()
            raise
        self._hand_on()

    def _on_image(self, message: AnyImage) -> None:
        stamp = conversions.stamp_ns(message)
        ahead = ahead_s(stamp, self._endpoints.now_ns())
        if ahead:
            detail = f"stamp is {ahead:.3f} s ahead of the clock"
            self._refuse(stamp, Finding(Reason.BAD_STAMP, ahead, MAX_AHEAD_NS * 1e-9, detail))
        self._waiting.append(message)
        self._hand_on()

    def _hand_on(self) -> None:
        """Hand on all images that are ready, and those that have waited for more than enough others."""
        patience = 0 if self._is_refused else self._params.max_waiting
        while self._waiting:
            fault = self._find_mounting(self._waiting[0])
            if fault is FINE:
                self._convert(self._waiting.popleft())
            elif len(self._waiting) > patience:
                self._on_refusal(conversions.stamp_ns(self._waiting.popleft()), fault)
            else:
                return

    def _find_mounting(self, message: AnyImage) -> Finding:
        """Return what is missing before an image can be used."""
        if self.camera is None:
            return self._fault
        base, frame = self._params.base_frame, self._params.camera_frame or message.header.frame_id
        if self._T_base_camera is None and self._mounting is not None:
            self._T_base_camera = self._mounting @ T_BODY_OPTICAL
        if self._T_base_camera is None:
            try:
                self._T_base_camera = self._tf.lookup(base, frame) if base and frame != base else SE3.identity()
            except ValueError as error:
                return Finding(Reason.TF_STALE, detail=str(error))
        return FINE

    def _convert(self, message: AnyImage) -> None:
        """Hand on one image; ValueError where it cannot be read, or is another camera's."""
        assert self.camera is not None
        stamp = conversions.stamp_ns(message)
        try:
            self._check_frames(message.header.frame_id)
        except ValueError as error:
            advice = "one node serves one camera: check the remapping of image_raw and camera_info, or call reset"
            self._refuse(stamp, Finding(Reason.BAD_INFO, detail=str(error), advice=advice))
        try:
            image = self._decode(message)
        except ValueError as error:
            self._refuse(stamp, Finding(Reason.BAD_INFO, detail=str(error), advice=ENCODINGS))
        self._on_picture(Picture(image, self.camera, stamp, self.T_base_camera, self.odometry.at(stamp)))

    def _check_frames(self, frame: str) -> None:
        """Raise ValueError where the image is not of the calibrated camera, or not of the one before."""
        self._image_frame = _same_frame("image_raw", self._image_frame, frame)
        if not self._params.camera_frame and self._info_frame and frame and self._info_frame != frame:
            raise ValueError(f"header.frame_id: expected that of camera_info, {self._info_frame!r}, found {frame!r}")

    def _decode(self, message: AnyImage) -> NDArray[Any]:
        """Return grey levels (H, W); a compressed image of another size than the camera's is not unpacked."""
        assert self.camera is not None
        if isinstance(message, Image):
            return conversions.image_to_grey(message)
        size = self.camera.width, self.camera.height
        return conversions.image_to_grey(conversions.compressed_to_image(message, size))

    def _refuse(self, stamp: int, finding: Finding) -> None:
        """Answer an image that is of no use, and count it as refused."""
        self._on_refusal(stamp, finding)
        raise ValueError(finding.detail)


def _same_frame(topic: str, before: str, frame: str) -> str:
    """Return the frame, which may be left empty, but not change."""
    if before and frame and before != frame:
        raise ValueError(f"{topic}: header.frame_id: expected {before!r} as before, found {frame!r}")
    return frame or before
