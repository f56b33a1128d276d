"""From images to pyramids: every image is checked; one of several cameras that is of no use is left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dense_localizer.motion_prior import MotionPrior
from dense_localizer.params import LocalizerParams
from sphere_nav.geometry import SE3, Camera
from sphere_nav.localization import FINE, Finding, InputCheck, Reason
from sphere_nav.photometric import build_pyramid
from sphere_nav.photometric.align.rig import RigImage

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CameraImage:
    """A grey image (H, W) and its camera; where that is on the body (None: it is the body itself), and its name.

    delay_s: when it was taken, after the stamp of the instant.
    """

    image: NDArray[Any]
    camera: Camera
    T_body_camera: SE3 | None = None
    name: str = ""
    delay_s: float = 0.0


@dataclass(frozen=True)
class Report:
    """The images that can be used, why one cannot (FINE: all can), and whether the stamps are of another time."""

    images: tuple[RigImage, ...]
    finding: Finding = FINE
    is_clock_jump: bool = False


class Inputs:
    """Checks the streams of the cameras of one body."""

    def __init__(self, params: LocalizerParams) -> None:
        self._params = params
        self.reset()

    def reset(self) -> None:
        """Forget the streams."""
        self.stream = InputCheck(self._params.input)  # the stamps that all cameras share
        self._checks: dict[str, InputCheck] = {}

    def check(self, images: Sequence[CameraImage], stamp_ns: int, prior: MotionPrior) -> Report:
        """Judge the images of one instant; the prior tells how the body moves, so where it was at the stamp of each."""
        stream = self.stream.check_stamp(stamp_ns)
        if not stream.is_good:
            return Report((), stream.finding)
        if stream.is_clock_jump:
            self._checks.clear()
        usable, findings = [], []
        for one in images:
            check = self._checks.setdefault(one.name, InputCheck(self._params.input))
            finding = check.check_image(one.image, one.camera, is_moving=prior.is_moving)
            findings.append(replace(finding, detail=f"camera {one.name}: {finding.detail}") if one.name else finding)
            if finding.reason is Reason.NONE:
                pyramid = build_pyramid(one.image, one.camera, self._params.registration.pyramid)
                usable.append(RigImage(pyramid, _at_stamp(one, prior.velocity), name=one.name))
        # Where one camera serves, what is wrong with another one is no reason against the pose.
        return Report(
            tuple(usable), next((f for f in findings if f.reason is not Reason.NONE), FINE), stream.is_clock_jump
        )


def _at_stamp(one: CameraImage, velocity: Array | None) -> SE3 | None:
    """Return where the camera was, seen from the body at the stamp of the instant."""
    if one.T_body_camera is None or velocity is None or one.delay_s == 0.0:
        return one.T_body_camera
    return SE3.exp(velocity * one.delay_s) @ one.T_body_camera
