"""One camera: its images with all that they need to be localized - calibration, and the camera's place on the base.

Images come raw or compressed by image_transport.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from sphere_nav_msgs.msg import SphereInfo

from sphere_nav.geometry import SE3, Camera, Spherical
from sphere_nav.geometry.arrays import Bytes, Size
from sphere_nav.geometry.files.encoded import encoded_size
from sphere_nav.geometry.plausible import check_mounting
from sphere_nav.localization.params import NodeParams
from sphere_nav.localization.status import Reason, Verdict
from sphere_nav.ros import conversions, qos
from sphere_nav.ros.camera.odometry_input import OdometryInput
from sphere_nav.ros.clocks import ahead_s
from sphere_nav.ros.constants import MAX_AHEAD_NS
from sphere_nav.ros.conversions.images import AnyImage as AnyImage
from sphere_nav.ros.endpoints import COMPRESSED, COMPRESSED_DEPTH, Endpoints
from sphere_nav.ros.tf import TransformListener
from sphere_nav.spheres.range_alignment import DepthImage
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, to_gray_bytes

ONE_CAMERA = "a topic is of one camera: check the remapping of image_raw and camera_info, or call reset"
ENCODINGS = "publish a usual encoding: mono8, mono16, rgb8, bgr8, rgba8, bgra8, or a PNG or JPEG"

NO_LENS = "no camera_info yet"


@dataclass(frozen=True)
class Picture:
    """One image with what belongs to it; `others` are those of the other cameras at the same instant."""

    image: NDArray[Any]  # grey (H, W)
    camera: Camera
    stamp_ns: int
    T_base_camera: SE3  # optical axes; those of the body (x ahead, y left, z up) of a panorama
    T_odom_base: SE3 | None
    name: str = ""
    others: tuple[Picture, ...] = ()
    depth: DepthImage | None = None


class CameraStream:
    """Subscribes; hands every image on at once, as a `Picture` or with what is wrong with it."""

    def __init__(
        self,
        endpoints: Endpoints,
        params: NodeParams,
        tf: TransformListener,
        odometry: OdometryInput,
        on_picture: Callable[[Picture], None],
        on_refusal: Callable[[int, Verdict], None],
        *,
        name: str = "",
        lens: Camera | None = None,
        place: Callable[[], SE3] | None = None,
    ) -> None:
        """`on_refusal(stamp_ns, finding)` gets the images that cannot be used.

        name: "" of the only camera, whose topics have no prefix. lens: None where camera_info or sphere_info say it.
        place: T_base_camera in optical axes, ValueError while it is not known; None where /tf_static says it by the
        frame of the images.
        """
        self._endpoints, self._params, self._tf, self._odometry = endpoints, params, tf, odometry
        self._on_picture, self._on_refusal = on_picture, on_refusal
        self._name, self._lens, self._place = name, lens, place
        self.forget_camera()
        profile = qos.DEEP if params.every_image else qos.SENSOR
        prefix = f"cameras/{name}/" if name else ""
        self.lens_topics = f"{prefix}camera_info, or {prefix}sphere_info of a panorama"
        if lens is None and not params.is_panorama:
            add = partial(endpoints.add_subscription, profile=profile, is_required=False)  # one of the two comes
            add(f"{prefix}camera_info", CameraInfo, self._on_camera_info)
            add(f"{prefix}sphere_info", SphereInfo, self._on_sphere_info)
        topic, kind = image_topic(f"{prefix}image_raw", params.transport)
        self.images = endpoints.add_subscription(topic, kind, self._on_image, profile)

    def forget_camera(self) -> None:
        """Accept the next calibration and frames as new ones."""
        self.camera: Camera | None = self._lens
        self.T_base_camera: SE3 | None = None
        self._fault = NO_LENS
        self._levels = conversions.Levels()
        self.image_frame = self._info_frame = ""

    @property
    def needs_lens(self) -> bool:
        """Whether no calibration has come yet."""
        return self.camera is None and self._fault is NO_LENS and not self._params.is_panorama

    def _on_camera_info(self, message: CameraInfo) -> None:
        is_rectified = self._params.is_rectified or conversions.is_rectified_topic(self.images.resolved)
        self._on_info(
            message.header.frame_id,
            lambda: conversions.camera_from_info(conversions.as_rectified(message, is_rectified=is_rectified)),
        )

    def _on_sphere_info(self, message: SphereInfo) -> None:
        self._on_info(message.frame_id, lambda: conversions.sphere_info_to_camera(message))

    def _on_info(self, frame: str, convert: Callable[[], Camera]) -> None:
        try:
            self._info_frame = _same_frame("camera_info", self._info_frame, frame)
            self.camera = convert()
        except ValueError as error:
            self.camera, self._fault = None, str(error)
            raise

    def _on_image(self, message: AnyImage) -> None:
        """Hand on one image; ValueError for one that cannot be used whatever comes."""
        stamp = conversions.stamp_ns(message)
        ahead = ahead_s(stamp, self._endpoints.now_ns())
        if ahead:
            detail = f"stamp is {ahead:.3f} s ahead of the clock"
            self._on_refusal(stamp, Verdict(Reason.BAD_STAMP, ahead, MAX_AHEAD_NS * 1e-9, detail))
            raise ValueError(detail)
        try:
            camera, T_base_camera = self._find_camera(message)
        except ValueError as error:
            reason = Reason.BAD_INFO if self.camera is None else Reason.TF_STALE
            self._on_refusal(stamp, Verdict(reason, detail=str(error)))
            return
        with self._answering(stamp, ONE_CAMERA):
            self._check_frames(message.header.frame_id)
        with self._answering(stamp, ENCODINGS):
            image = read_gray(message, (camera.width, camera.height), self._levels)
        odometry = self._odometry.predict(stamp)
        self._on_picture(Picture(image, camera, stamp, T_base_camera, odometry, self._name))

    @contextmanager
    def _answering(self, stamp: int, advice: str) -> Iterator[None]:
        """Answer an image by the ValueError that says why it is of no use."""
        try:
            yield
        except ValueError as error:
            self._on_refusal(stamp, Verdict(Reason.BAD_INFO, detail=str(error), advice=advice))
            raise

    def _find_camera(self, message: AnyImage) -> tuple[Camera, SE3]:
        """Return the camera and T_base_camera; ValueError while nobody says them."""
        if self._params.is_panorama and self.camera is None:
            self._on_info(message.header.frame_id, lambda: panorama_of(message))
        if self.camera is None:
            raise ValueError(self._fault)
        self.T_base_camera = self.T_base_camera or self._look_up(message.header.frame_id, self.camera)
        return self.camera, self.T_base_camera

    def _look_up(self, image_frame: str, camera: Camera) -> SE3:
        """Return T_base_camera; ValueError while nobody says it."""
        if self._place is not None:
            T_base_camera = self._place()
            return T_base_camera @ T_BODY_OPTICAL.inverse() if isinstance(camera, Spherical) else T_base_camera
        base, frame = self._params.base_frame, self._params.camera_frame or image_frame
        T_base_camera = self._tf.lookup(base, frame) if base and frame != base else SE3.identity()
        check_mounting(T_base_camera.translation, f"{base} to {frame}")
        return T_base_camera

    def _check_frames(self, frame: str) -> None:
        """Raise ValueError where the image is not of the calibrated camera, or not of the one before."""
        self.image_frame = _same_frame("image_raw", self.image_frame, frame)
        if not self._params.camera_frame and self._info_frame and frame and self._info_frame != frame:
            raise ValueError(f"header.frame_id: expected that of camera_info, {self._info_frame!r}, found {frame!r}")


def panorama_of(message: AnyImage) -> Spherical:
    """Return the camera of an equirectangular image; ValueError for one that is not twice as wide as high."""
    width, height = (message.width, message.height) if isinstance(message, Image) else encoded_size(bytes(message.data))
    if width != 2 * height or not width:
        raise ValueError(f"image size: expected a whole sphere, twice as wide as high, found {width} x {height}")
    return Spherical(width, height)


def _same_frame(topic: str, before: str, frame: str) -> str:
    """Return the frame, which may be left empty, but not change."""
    if before and frame and before != frame:
        raise ValueError(f"{topic}: header.frame_id: expected {before!r} as before, found {frame!r}")
    return frame or before


def image_topic(topic: str, transport: str, *, is_depth: bool = False) -> tuple[str, type[Any]]:
    """Return the topic by its transport, `raw` or `compressed`, and the kind of its messages."""
    if transport == "raw":
        return topic, Image
    return topic + (COMPRESSED_DEPTH if is_depth else COMPRESSED), CompressedImage


def read_gray(message: AnyImage, size: Size | None = None, levels: conversions.Levels | None = None) -> Bytes:
    """Return grey levels (H, W) uint8; `size` and `levels` as of `image_to_rgb`."""
    return to_gray_bytes(conversions.image_to_rgb(message, levels, size))
