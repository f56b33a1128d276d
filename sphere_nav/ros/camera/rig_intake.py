"""Several cameras that are fixed to one another: the images of one instant go on together.

Instants are made by stamps alone, so that a replay makes the same ones: one is complete with an image of every camera
that still delivers, or when the next one begins.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

from sphere_nav.geometry import SE3, Rig
from sphere_nav.localization.params import NodeParams, RigParams
from sphere_nav.localization.status import FINE, Finding, Reason
from sphere_nav.ros.camera.mounting import read_mounting
from sphere_nav.ros.camera.odometry_input import OdometryInput
from sphere_nav.ros.camera.stream import CameraStream, Fixture, Picture
from sphere_nav.ros.endpoints import ERROR, OK, Endpoints
from sphere_nav.ros.tf import TransformListener

MAX_MISSES = 3  # instants in a row without an image, after which a camera is not waited for
BACK_NS = 1_000_000_000  # stamps so far before the last instant are of another time
SILENCE_NS = 500_000_000  # without any instant, until what is refused of one camera is the answer


class Instants:
    """Gathers the pictures of several cameras by their stamps."""

    def __init__(self, names: Sequence[str], slack_s: float, hand_on: Callable[[dict[str, Picture]], None]) -> None:
        """`hand_on` gets the pictures of an instant by camera, in the order of the names."""
        self._names, self._slack_ns, self._hand_on = tuple(names), round(slack_s * 1e9), hand_on
        self.clear()

    def clear(self) -> None:
        """Forget everything with a stamp."""
        self._open: dict[str, Picture] = {}
        self._first_ns = self._closed_ns = -BACK_NS
        self._misses = dict.fromkeys(self._names, 0)

    def add(self, name: str, picture: Picture) -> None:
        """Add a picture; hand on the instant before it, or its own. ValueError: its instant has been handed on."""
        stamp = picture.stamp_ns
        if stamp < self._closed_ns - BACK_NS:
            self.clear()
        self._misses[name] = 0
        if stamp <= self._closed_ns + self._slack_ns or (self._open and stamp < self._first_ns - self._slack_ns):
            raise ValueError(f"camera {name}: its image came after the next instant had begun")
        if self._open and (name in self._open or stamp > self._first_ns + self._slack_ns):
            self._close()
        if not self._open:
            self._first_ns = stamp
        self._open[name] = picture
        if all(other in self._open or self._misses[other] >= MAX_MISSES for other in self._names):
            self._close()

    def _close(self) -> None:
        pictures, self._open = {name: self._open[name] for name in self._names if name in self._open}, {}
        for name in self._names:
            self._misses[name] = 0 if name in pictures else self._misses[name] + 1
        self._closed_ns = self._first_ns
        self._hand_on(pictures)


@dataclass(frozen=True)
class Losses:
    """What became of the images of all cameras."""

    num_lost: int
    num_refused: int


class RigIntake:
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
        self.odometry = OdometryInput(endpoints, self._tf.tree, params.base_frame, is_used=params.use_odometry)
        self._mounting = read_mounting(params.mounting)
        self._instants = Instants(names, rig.slack, self._on_instant)
        self._faults: dict[str, Finding] = {}
        self._streams = {name: self._stream(name, calibration, has_sphere_info=has_sphere_info) for name in names}

    def clear(self) -> None:
        """Forget what has a stamp: the clock jumped."""
        self.odometry.clear()
        self._tf.tree.clear()
        self._instants.clear()
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
        self._instants.add(name, picture)

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
