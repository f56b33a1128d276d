"""From images to pyramids: every image is checked; one of several cameras that is of no use is left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dense_localizer.constants import MOVING_SPEED
from dense_localizer.params import LocalizerParams
from sphere_nav.geometry import SE3, Camera
from sphere_nav.geometry.arrays import Array
from sphere_nav.localization import FINE, InputCheck, Reason, Verdict
from sphere_nav.localization.constants import SAMPLE_STEP
from sphere_nav.photometric import build_pyramid
from sphere_nav.photometric.align.problem import RigImage
from sphere_nav.photometric.pixels.pyramid import match_sharpness
from sphere_nav.spheres.range_alignment import DepthImage


@dataclass(frozen=True)
class CameraImage:
    """A grey image (H, W) and its camera; where that is on the body (None: it is the body itself), and its name.

    delay_s: when it was taken, after the stamp of the instant. depth: what a depth camera beside it saw.
    """

    image: NDArray[Any]
    camera: Camera
    T_body_camera: SE3 | None = None
    name: str = ""
    delay_s: float = 0.0
    depth: DepthImage | None = None


@dataclass(frozen=True)
class LocalizerInput:
    """The images of one instant with their pyramids (none where all are of no use, `finding` says why) and odometry.

    depth: that of a camera; its pose is on the body.
    """

    stamp_ns: int
    finding: Verdict = FINE
    images: tuple[RigImage, ...] = ()
    T_odom_camera: SE3 | None = None  # of the body, where cameras are several
    is_clock_jump: bool = False  # stamps are of another time from here on
    depth: DepthImage | None = None


class Inputs:
    """Checks the streams of the cameras of one body."""

    def __init__(self, params: LocalizerParams, pixels_per_radian: float) -> None:
        """Check for a map whose key spheres have so many pixels per radian."""
        self._params, self._pixels_per_radian = params, pixels_per_radian
        self.reset()

    def reset(self) -> None:
        """Forget the streams."""
        self.stream = InputCheck(self._params.input)  # the stamps that all cameras share
        self._checks: dict[str, InputCheck] = {}
        self._depth_check = InputCheck(self._params.input)

    def check(
        self,
        images: Sequence[CameraImage],
        stamp_ns: int,
        T_odom_camera: SE3 | None = None,
        velocity: Array | None = None,
    ) -> LocalizerInput:
        """Check the images of one instant; the last velocity (6,) of the body says where it was at the stamp of each.

        BAD_STAMP where the instant does not count; where one camera serves, what is wrong with another is no reason
        against the pose.
        """
        stream = self.stream.check_stamp(stamp_ns)
        if not stream.is_good:
            return LocalizerInput(stamp_ns, stream.finding)
        if stream.is_clock_jump:
            self._checks.clear()
            self._depth_check.reset()
        is_moving = velocity is None or float(np.linalg.norm(velocity[:3])) > MOVING_SPEED
        usable, findings = [], []
        for one in images:
            check = self._checks.setdefault(one.name, InputCheck(self._params.input))
            finding = check.check_image(one.image, one.camera, is_moving=is_moving)
            findings.append(replace(finding, detail=f"camera {one.name}: {finding.detail}") if one.name else finding)
            if finding.reason is Reason.NONE:
                pyramid = build_pyramid(one.image, one.camera, self._params.registration.pyramid)
                pyramid = match_sharpness(pyramid, self._pixels_per_radian)
                usable.append(RigImage(pyramid, _mount_at_stamp(one, velocity), name=one.name))
        finding = next((one for one in findings if one.reason is not Reason.NONE), FINE)
        seen = next((one for one in images if one.depth is not None), None)
        depth = self._check_depth(seen, finding, is_moving=is_moving) if seen is not None else None
        return LocalizerInput(stamp_ns, finding, tuple(usable), T_odom_camera, stream.is_clock_jump, depth)

    def _check_depth(self, one: CameraImage, finding: Verdict, *, is_moving: bool) -> DepthImage | None:
        """Return the depth beside an image, seen from the body; None where it is frozen, or the camera is not to trust.

        An image in which nothing is seen is no reason against it.
        """
        assert one.depth is not None
        sample = np.nan_to_num(one.depth.depth_m[::SAMPLE_STEP, ::SAMPLE_STEP])
        frozen = self._depth_check.check_frozen(sample, is_moving=is_moving)
        if frozen.reason is not Reason.NONE or finding.reason not in (Reason.NONE, Reason.LOW_TEXTURE):
            return None
        if one.T_body_camera is None:
            return one.depth
        return replace(one.depth, T_image_depth=one.T_body_camera @ one.depth.T_image_depth)


def _mount_at_stamp(one: CameraImage, velocity: Array | None) -> SE3 | None:
    """Return where the camera was, seen from the body at the stamp of the instant."""
    if one.T_body_camera is None or velocity is None or one.delay_s == 0.0:
        return one.T_body_camera
    return SE3.exp(velocity * one.delay_s) @ one.T_body_camera
