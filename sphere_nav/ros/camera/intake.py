"""The cameras of a localizer, one or several that are fixed to one another, with depth or without, and odometry."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from sensor_msgs.msg import CameraInfo

from sphere_nav.geometry import SE3, Camera, Rig
from sphere_nav.localization.params import NodeParams, RigParams
from sphere_nav.localization.status import FINE, Reason, Verdict
from sphere_nav.ros import conversions, qos
from sphere_nav.ros.camera.mounting import read_mounting
from sphere_nav.ros.camera.odometry_input import OdometryInput
from sphere_nav.ros.camera.stream import AnyImage, CameraStream, Picture, image_topic
from sphere_nav.ros.camera.synchronizer import Instant, Synchronizer
from sphere_nav.ros.constants import DEPTH_SLACK_S, SILENCE_NS
from sphere_nav.ros.endpoints import ERROR, OK, Endpoints
from sphere_nav.ros.tf import TransformListener
from sphere_nav.spheres.range_alignment import DepthImage
from sphere_nav.spheres.sphere import T_BODY_OPTICAL

DEPTH, DEPTH_INFO = "depth/image_raw", "depth/camera_info"
ONLY = ("",)  # the name of the only camera


class Cameras:
    """Hands on the images of each instant as one `Picture` of the first camera, `others` and depth with it.

    An image of the only camera waits for nothing but its depth, and that until the next one comes. Depth is of that
    camera where it has no calibration of its own, else of one beside it by /tf_static.
    """

    def __init__(
        self,
        endpoints: Endpoints,
        params: NodeParams,
        on_picture: Callable[[Picture], None],
        on_refusal: Callable[[int, Verdict], None],
        *,
        rig: RigParams | None = None,
        calibration: Rig | None = None,
        has_depth: bool = False,
    ) -> None:
        """`on_refusal(stamp_ns, finding)` gets the images that cannot be used.

        `rig`: of several cameras; `calibration` gives their lenses and poses, else camera_info and /tf_static do.
        """
        if rig is not None and not params.base_frame:
            raise ValueError("base_frame: expected a frame, which several cameras share, found none")
        names = ONLY if rig is None else rig_names(rig, calibration)
        self._endpoints, self._params, self._rig_frame = endpoints, params, rig.frame if rig is not None else ""
        self._on_picture, self._on_refusal, self._handed_ns = on_picture, on_refusal, -SILENCE_NS
        self._profile = qos.DEEP if params.every_image else qos.SENSOR  # where every image is answered, none is lost
        self._tf = TransformListener(endpoints, ignored=params.map_frame)
        self.odometry = OdometryInput(endpoints, self._tf, params.base_frame, self._profile)
        self._mounting = read_mounting(params.mounting)
        slack_s = DEPTH_SLACK_S if rig is None else rig.slack
        self._synchronizer = Synchronizer((*names, *[DEPTH] * has_depth), slack_s)
        self._faults: dict[str, Verdict] = {}
        self._streams = {name: self._stream(name, calibration) for name in names}
        if has_depth:
            self._subscribe_depth()

    def clear(self) -> None:
        """Forget what has a stamp: the clock jumped."""
        self.odometry.clear()
        self._tf.clear()
        self._synchronizer.clear()

    def forget_camera(self) -> None:
        """Accept the next calibration, frames and odometry as new ones."""
        self.odometry.reset()
        self._faults.clear()
        for stream in self._streams.values():
            stream.forget_camera()

    @property
    def num_lost(self) -> int:
        """Images of all cameras that were lost."""
        return sum(stream.images.num_lost for stream in self._streams.values())

    @property
    def fault(self) -> Verdict:
        """What is wrong with a camera that took no part in the last instant; of the only one its images tell it."""
        return next((fault for fault in self._faults.values() if fault is not FINE), FINE)

    @property
    def lack(self) -> str:
        """The calibration that nobody has sent yet; empty where each camera has one."""
        return next((stream.lens_topics for stream in self._streams.values() if stream.needs_lens), "")

    @property
    def is_mounted(self) -> bool:
        """Whether it is known where some camera is on the base."""
        return any(stream.T_base_camera is not None for stream in self._streams.values())

    @property
    def T_base_camera(self) -> SE3:
        """The only camera on the base, optical axes; of several, or before it is known, the base itself."""
        only = self._streams.get(ONLY[0])
        return (only.T_base_camera if only else None) or SE3.identity()

    def _stream(self, name: str, calibration: Rig | None) -> CameraStream:
        known = calibration.camera(name) if calibration is not None else None
        T_rig_camera = known.T_rig_camera if known else T_BODY_OPTICAL if self._mounting and not name else None
        shared = self._endpoints, self._params, self._tf, self.odometry
        callbacks = partial(self._on_camera, name), partial(self._on_fault, name)
        place = partial(self._find_place, T_rig_camera) if T_rig_camera else None
        return CameraStream(*shared, *callbacks, name=name, lens=known.camera if known else None, place=place)

    def _subscribe_depth(self) -> None:
        self._depth_info: CameraInfo | None = None
        take, add = partial(setattr, self, "_depth_info"), self._endpoints.add_subscription
        add(DEPTH_INFO, CameraInfo, take, self._profile, is_required=False)
        topic, kind = image_topic(DEPTH, self._params.transport, is_depth=True)
        self._depth = add(
            topic, kind, lambda message: self._put(DEPTH, conversions.stamp_ns(message), message), self._profile
        )

    def _find_place(self, T_rig_camera: SE3) -> SE3:
        """Return where a camera of the rig is on the base; ValueError while nobody says it."""
        return (self._mounting or self._tf.lookup(self._params.base_frame, self._rig_frame)) @ T_rig_camera

    def _on_camera(self, name: str, picture: Picture) -> None:
        if self._synchronizer.names == ONLY:
            self._on_picture(picture)
        else:
            self._put(name, picture.stamp_ns, picture)

    def _put(self, name: str, stamp_ns: int, what: Any) -> None:
        for instant in self._synchronizer.put(name, stamp_ns, what):
            self._on_instant(instant)

    def _on_instant(self, instant: Instant) -> None:
        """Hand images on; ValueError for depth that cannot be used, after they have gone on."""
        pictures: dict[str, Picture] = {name: instant.images[name] for name in self._streams if name in instant.images}
        if not pictures:
            return
        self._handed_ns = self._endpoints.own_ns()
        if ONLY[0] not in self._streams:
            self._note_faults(pictures)
        first, *others = pictures.values()
        picture, message = replace(first, others=tuple(others)), instant.images.get(DEPTH)
        try:
            depth = self._convert(message, picture.camera) if message is not None else None
        except ValueError:
            self._on_picture(picture)
            raise
        self._on_picture(replace(picture, depth=depth))

    def _convert(self, message: AnyImage, camera: Camera) -> DepthImage:
        depth_m, info, T_image_depth = conversions.depth_to_meters(message), self._depth_info, SE3.identity()
        if info is not None:
            is_rectified = self._params.is_rectified or conversions.is_rectified_topic(self._depth.resolved)
            camera = conversions.camera_from_info(conversions.as_rectified(info, is_rectified=is_rectified))
            frame, own = info.header.frame_id or message.header.frame_id, self._streams[ONLY[0]].image_frame
            own = self._params.camera_frame or own
            T_image_depth = SE3.identity() if frame in ("", own) else self._tf.lookup(own, frame)
        conversions.check_image_size(camera, depth_m.shape[1], depth_m.shape[0])
        return DepthImage(depth_m, camera, T_image_depth)

    def _note_faults(self, pictures: dict[str, Picture]) -> None:
        for name in self._streams:
            if name in pictures:
                self._note_fault(name, FINE)
            elif self._faults.get(name, FINE) is FINE:
                self._note_fault(name, Verdict(Reason.GAP, detail=f"camera {name}: no image at this instant"))

    def _note_fault(self, name: str, fault: Verdict) -> None:
        self._faults[name] = fault
        level = OK if fault is FINE else ERROR
        self._endpoints.report(f"camera {name}", level, fault.detail or "delivers")

    def _on_fault(self, name: str, stamp_ns: int, finding: Verdict) -> None:
        """Answer an image by what is wrong with it; of several cameras, only where no other one delivers."""
        if name:
            finding = replace(finding, detail=f"camera {name}: {finding.detail}")
            self._note_fault(name, finding)
        if not name or self._endpoints.own_ns() - self._handed_ns >= SILENCE_NS:
            self._on_refusal(stamp_ns, finding)


def rig_names(rig: RigParams, calibration: Rig | None) -> tuple[str, ...]:
    """Return the names of the cameras; ValueError for none, one twice, or one that the calibration does not know."""
    names = tuple(name.strip() for name in rig.cameras.split(",") if name.strip())
    known = calibration.names if calibration is not None else names
    names = names or known
    unknown = [name for name in names if name not in known]
    if not names or len(set(names)) < len(names) or unknown:
        offered = f" of {', '.join(known)}" if unknown else ""
        raise ValueError(f"rig.cameras: expected different names{offered}, found {rig.cameras or 'none'}")
    return names
