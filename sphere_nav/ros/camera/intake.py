"""The camera of a localizer, or several that are fixed to one another, and odometry at their stamps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

from sphere_nav.geometry import SE3, Camera, Rig
from sphere_nav.localization.params import NodeParams, RigParams
from sphere_nav.localization.status import FINE, Finding, Reason
from sphere_nav.ros import qos
from sphere_nav.ros.camera.mounting import read_mounting
from sphere_nav.ros.camera.odometry_input import OdometryInput
from sphere_nav.ros.camera.stream import CameraStream, Fixture, Picture
from sphere_nav.ros.camera.synchronizer import Synchronizer
from sphere_nav.ros.constants import SILENCE_NS
from sphere_nav.ros.endpoints import ERROR, OK, Endpoints
from sphere_nav.ros.subscription import Subscription
from sphere_nav.ros.tf import TransformListener, TransformTree
from sphere_nav.spheres.sphere import T_BODY_OPTICAL


def make_odometry(endpoints: Endpoints, tree: TransformTree, params: NodeParams) -> OdometryInput:
    """Return the input of odometry; where every image is answered, none of it is lost, either."""
    profile = qos.DEEP if params.every_image else qos.SENSOR
    return OdometryInput(endpoints, tree, params.base_frame, is_used=params.use_odometry, profile=profile)


class CameraIntake:
    """Hands every image of one camera on, in order, as a `Picture` or with what is wrong with it."""

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
        self._params, self._tf = params, TransformListener(endpoints, ignored=params.map_frame)
        self.odometry = make_odometry(endpoints, self._tf.tree, params)
        mounting = read_mounting(params.mounting)
        T_base_camera = mounting @ T_BODY_OPTICAL if mounting is not None else None
        fixture = Fixture(T_base_camera=(lambda: T_base_camera) if T_base_camera is not None else None)
        shared = endpoints, params, self._tf, self.odometry, fixture
        self._stream = CameraStream(*shared, on_picture, on_refusal, has_sphere_info=has_sphere_info)

    def clear(self) -> None:
        """Forget what has a stamp: the clock jumped."""
        self.odometry.clear()
        self._tf.tree.clear()
        self._stream.clear()

    def forget_camera(self) -> None:
        """Accept the next calibration, frames and odometry as new ones."""
        self._stream.forget_camera()
        self.odometry.reset()

    def find_pose(self, frame: str) -> SE3:
        """Return where a frame is, seen from the camera; ValueError while nobody says it."""
        image_frame = self._params.camera_frame or self._stream.image_frame
        return SE3.identity() if frame in ("", image_frame) else self._tf.lookup(image_frame, frame)

    @property
    def images(self) -> Subscription:
        """The topic of the images: how many came, were refused, were lost."""
        return self._stream.images

    @property
    def fault(self) -> Finding:
        """Nothing: what is wrong with the only camera is the answer to its images."""
        return FINE

    @property
    def camera(self) -> Camera | None:
        """The camera, once it is known."""
        return self._stream.camera

    @property
    def is_mounted(self) -> bool:
        """Whether it is known where the camera is on the base."""
        return self._stream.T_base_camera is not None

    @property
    def T_base_camera(self) -> SE3:
        """The camera on the base, optical axes; identity before it is known."""
        return self._stream.T_base_camera or SE3.identity()


@dataclass(frozen=True)
class Losses:
    """What became of the images of all cameras."""

    num_lost: int
    num_refused: int


class MultiCameraIntake:
    """Hands on the images of each instant as one `Picture` of the first camera, `others` with it."""

    def __init__(
        self,
        endpoints: Endpoints,
        params: NodeParams,
        rig: RigParams,
        calibration: Rig | None,
        on_picture: Callable[[Picture], None],
        on_refusal: Callable[[int, Finding], None],
        *,
        has_sphere_info: bool = False,
    ) -> None:
        """`calibration` gives lenses and poses on `rig.frame`; None: camera_info and /tf_static do."""
        if not params.base_frame:
            raise ValueError("base_frame: expected a frame, which several cameras share, found none")
        names = rig_names(rig, calibration)
        self._endpoints, self._params, self._frame = endpoints, params, rig.frame
        self._on_picture, self._on_refusal, self._handed_ns = on_picture, on_refusal, -SILENCE_NS
        self._tf = TransformListener(endpoints, ignored=params.map_frame)
        self.odometry = make_odometry(endpoints, self._tf.tree, params)
        self._mounting = read_mounting(params.mounting)
        self._synchronizer = Synchronizer(names, rig.slack)
        self._faults: dict[str, Finding] = {}
        self._streams = {name: self._stream(name, calibration, has_sphere_info=has_sphere_info) for name in names}

    def clear(self) -> None:
        """Forget what has a stamp: the clock jumped."""
        self.odometry.clear()
        self._tf.tree.clear()
        self._synchronizer.clear()
        for stream in self._streams.values():
            stream.clear()

    def forget_camera(self) -> None:
        """Accept the next calibration, frames and odometry as new ones."""
        self.odometry.reset()
        self._faults.clear()
        for stream in self._streams.values():
            stream.forget_camera()

    @property
    def images(self) -> Losses:
        """How many images were refused, and how many lost."""
        topics = [stream.images for stream in self._streams.values()]
        return Losses(sum(one.num_lost for one in topics), sum(one.num_refused for one in topics))

    @property
    def fault(self) -> Finding:
        """What is wrong with a camera that took no part in the last instant."""
        return next(iter(self._faults.values()), FINE)

    @property
    def is_mounted(self) -> bool:
        """Whether it is known where some camera is on the base."""
        return any(stream.T_base_camera is not None for stream in self._streams.values())

    @property
    def T_base_camera(self) -> SE3:
        """The pose of the base is what all cameras share."""
        return SE3.identity()

    def _stream(self, name: str, calibration: Rig | None, *, has_sphere_info: bool) -> CameraStream:
        fixture = Fixture(name)
        if calibration is not None:
            camera = calibration.camera(name)
            fixture = Fixture(name, lambda: self._T_base_rig() @ camera.T_rig_camera, camera.camera)
        callbacks = partial(self._on_camera, name), partial(self._on_fault, name)
        shared = self._endpoints, self._params, self._tf, self.odometry, fixture
        return CameraStream(*shared, *callbacks, has_sphere_info=has_sphere_info)

    def _T_base_rig(self) -> SE3:
        """Return where the rig is; ValueError while nobody says it."""
        if self._mounting is not None:
            return self._mounting
        return self._tf.lookup(self._params.base_frame, self._frame)

    def _on_camera(self, name: str, picture: Picture) -> None:
        for instant in self._synchronizer.put(name, picture.stamp_ns, picture):
            self._on_instant(instant.images)

    def _on_instant(self, pictures: dict[str, Picture]) -> None:
        self._handed_ns = self._endpoints.own_ns()
        for name in self._streams:
            if name in pictures:
                self._faults.pop(name, None)
            else:
                self._faults.setdefault(name, self._find_lack(name))
            fault = self._faults.get(name, FINE)
            self._endpoints.report(f"camera {name}", ERROR if name in self._faults else OK, fault.detail or "delivers")
        first, *others = pictures.values()
        self._on_picture(replace(first, others=tuple(others)))

    def _find_lack(self, name: str) -> Finding:
        """Return why a camera takes no part in an instant."""
        lack = self._streams[name].lack
        if lack is FINE:
            return Finding(Reason.GAP, detail=f"camera {name}: no image at this instant")
        return replace(lack, detail=f"camera {name}: {lack.detail}")

    def _on_fault(self, name: str, stamp_ns: int, finding: Finding) -> None:
        """Keep what is wrong with one camera; it is the answer where no other camera delivers."""
        finding = replace(finding, detail=f"camera {name}: {finding.detail}")
        self._faults[name] = finding
        self._endpoints.report(f"camera {name}", ERROR, finding.detail)
        if self._endpoints.own_ns() - self._handed_ns >= SILENCE_NS:
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
