"""A stereo pair by its messages: rectified or as the cameras give it, with D, R, P or a transform between them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from sensor_msgs.msg import CameraInfo

from sphere_mapping.acquisition.partial.window import upright_axes
from sphere_mapping.acquisition.stereo.stereo import sphere_from_stereo
from sphere_mapping.acquisition.stereo.stereo_pair import PairGeometry, StereoPair, geometry_of
from sphere_mapping.params import MapperParams
from sphere_mapping.ros.mount import CameraMount
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.ros import conversions
from sphere_nav.ros.camera.synchronizer import Instant
from sphere_nav.ros.endpoints import OK, WARN
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, Sphere

IMAGES = ("left/image_raw", "right/image_raw")
LEFT, RIGHT = "left/camera_info", "right/camera_info"


Report = Callable[..., None]  # what, level, words: for the diagnostics
OnPair = Callable[[Any, Any, StereoPair], None]  # both rectified images


def report_nothing(*_: object) -> None:
    """Tell nobody."""


class StereoIntake:
    """Makes spheres of the images of a pair, whose correction it finds, or is told.

    `report` takes what, level and words about the rows; `on_pair` takes the rectified images in place of a sphere.
    """

    def __init__(
        self, params: MapperParams, lookup: Callable[[str, str], SE3], report: Report, on_pair: OnPair | None
    ) -> None:
        self._params, self._lookup, self._report, self._on_pair = params, lookup, report, on_pair
        self._pair: StereoPair | None = None

    def use(self, pair: StereoPair) -> None:
        """Rectify by what is known of the pair, not by its calibration and its own rows."""
        self._pair = pair

    def make(
        self, instant: Instant, mount: CameraMount, left_info: CameraInfo, right_info: CameraInfo
    ) -> tuple[Sphere, CameraMount, None] | None:
        """Return the sphere of an instant; None where `on_pair` takes its images."""
        if self._pair is None:
            self._pair = StereoPair(open_pair(left_info, right_info, self._lookup))
        pair = self._pair
        images = [instant.images[topic] for topic in IMAGES]
        for image, lens in zip(images, (pair.geometry.left, pair.geometry.right), strict=True):
            conversions.check_image_size(lens, image.shape[1], image.shape[0])
        left, right = pair.rectify(*images)
        self._report("stereo", *describe_rows(pair, self._params.stereo.calibration_px))
        if self._on_pair is not None:
            self._on_pair(left, right, pair)
            return None
        geometry, p = pair.geometry, self._params
        mount = replace(mount, T_sphere_body=upright_axes(mount.T_base_body, geometry.camera))
        T_sphere_left = mount.T_sphere_body @ T_BODY_OPTICAL
        T_sphere_camera = T_sphere_left @ SE3.from_parts(geometry.R_rectified_left.T, np.zeros(3))
        place = geometry.camera, geometry.baseline_m, T_sphere_camera
        sphere = sphere_from_stereo(left, right, *place, instant.stamp_ns, p.stereo, p.partial, pair.is_seen)
        return sphere, mount, None


def open_pair(left: CameraInfo, right: CameraInfo, lookup: Callable[[str, str], SE3]) -> PairGeometry:
    """Return the geometry of two calibrations; ValueError where they and /tf do not tell how it is to be rectified.

    `lookup(target, source)` tells T_target_source of two frames, as /tf_static has it, or raises ValueError.
    """
    if conversions.has_baseline(right) and left.p[0] > 0.0:
        return _by_projections(left, right)
    frames = left.header.frame_id, right.header.frame_id
    try:
        if not all(frames) or frames[0] == frames[1]:
            raise ValueError(f"both images are in frame {frames[0]!r}")
        T_left_right = lookup(*frames)
    except ValueError as error:
        raise ValueError(
            f"{RIGHT}: P[3]: expected -fx * baseline < 0, or a transform between the frames of both cameras, "
            f"found {right.p[3]}, and {error}"
        ) from None
    return geometry_of(conversions.camera_from_info(left), conversions.camera_from_info(right), T_left_right)


def _by_projections(left: CameraInfo, right: CameraInfo) -> PairGeometry:
    """Return the geometry that P and R tell; where K says nothing, the images are rectified."""
    camera = conversions.camera_from_info(conversions.as_rectified(left))
    if not isinstance(camera, Pinhole):
        raise ValueError(f"{LEFT}: expected a rectified pinhole camera, found {camera.model}")
    conversions.camera_from_info(conversions.as_rectified(right))  # refused where it is none
    lens, other = (conversions.camera_from_info(info) if info.k[0] else camera for info in (left, right))
    turn, other_turn = (conversions.rectification_of(info) for info in (left, right))
    return PairGeometry(lens, other, turn, other_turn, camera, conversions.stereo_baseline(right))


def describe_rows(pair: StereoPair, calibration_px: float) -> tuple[int, str]:
    """Return level and words about the rows of a pair for the diagnostics."""
    if pair.fit is None:
        return OK, "rows as told"
    text = (
        f"rows off by {pair.rows_px:.2f} px, corrected by {pair.fit.num_points} corners to {pair.fit.after_px:.2f} px"
    )
    if pair.rows_px > calibration_px:
        return WARN, f"{text}; expected {calibration_px} px (stereo.calibration_px): calibrate the pair anew"
    return OK, text
