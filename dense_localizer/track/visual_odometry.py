"""Where the map does not fit, the last image does: one more reference in the same alignment (M15 section 5.3).

Its grey levels are of now, so that a lamp that was switched, a saturated wall or an occlusion cost nothing beyond one
image; its range is that of the key spheres, warped to where it was taken. What is found so drifts: the covariance grows
with the way, and after a stated distance the pose is lost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from dense_localizer.constants import (
    GAP_S,
    IMAGE_FORGETTING,
    MAX_INNOVATION,
    MAX_LEVEL_PIXELS,
    MIN_EXPLAINED_NCC,
    VO_DRIFT,
    VO_MAX_S,
    VO_MAX_SIGMA_M,
)
from dense_localizer.inputs import LocalizerInput
from dense_localizer.judge.candidate import Acceptance, PoseCandidate
from dense_localizer.motion_prior import Prediction, measure_position_sigma
from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import References, RigChoice
from sphere_nav.estimation.least_squares import squared_distance
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.localization.status import Verdict
from sphere_nav.photometric import Alignment, RegistrationParams, View, prepare_reference
from sphere_nav.photometric.align.esm import register_rig
from sphere_nav.photometric.align.iteration.kernels import BLOCK, SIDE
from sphere_nav.photometric.align.problem import MAX_VIEWS, RigImage, share_pixels
from sphere_nav.photometric.params import between
from sphere_nav.photometric.pixels.reference import choose_pixels


@dataclass(frozen=True)
class Way:
    """The way since the map was last sure: the pose there and its covariance (6, 6), and the noise (6, 6) of steps."""

    T_map_start: SE3
    covariance: Array
    stamp_ns: int
    meters: float = 0.0
    noise: Array = field(default_factory=lambda: np.zeros((6, 6)))

    def add_step(self, T_map_before: SE3, T_map_now: SE3, noise: Array) -> Way:
        """Return the way with one more step, whose alignment has a covariance (6, 6)."""
        T_now_before = T_map_now.inverse() @ T_map_before
        Ad, step = T_now_before.adjoint(), float(np.linalg.norm(T_now_before.translation))
        return replace(self, meters=self.meters + step, noise=noise + Ad @ self.noise @ Ad.T)

    def covariance_at(self, T_map_now: SE3) -> Array:
        """Return the covariance (6, 6) of the pose at its end: of the start, of the steps, and of what they share."""
        Ad = (T_map_now.inverse() @ self.T_map_start).adjoint()
        return Ad @ self.covariance @ Ad.T + self.noise + np.diag((VO_DRIFT * self.meters) ** 2)


class VisualOdometry:
    """Keeps the last image that was placed, and the way since the map was last sure."""

    def __init__(self, references: References, params: LocalizerParams) -> None:
        self._references, self._params = references, params
        self.reset()

    def reset(self) -> None:
        """Nothing is known of the past."""
        self._last: PoseCandidate | None = None
        self._way: Way | None = None
        self._usual_ncc = {False: 0.0, True: 0.0}  # of images and map, by grey levels and by local contrast

    def usual_ncc(self, by_contrast: bool) -> float:
        """Return how well images have resembled the map, by local contrast or grey levels; 0: nobody knows."""
        return self._usual_ncc[by_contrast]

    @property
    def is_needed(self) -> bool:
        """Whether the last images were not placed by the map."""
        return self._way is not None and self._way.meters > 0.0

    def verify(self, frame: LocalizerInput, by_map: PoseCandidate, *, is_trusted: bool) -> PoseCandidate:
        """Return the candidate of the map; where it is refused, that of the last images.

        Only a pose that `is_trusted` is propagated by images; else the refused candidate is returned. Odometry is
        defied by a whole view only: one that shows the map in parts may show another place in the others.
        """
        if by_map.prediction.defies_odometry:
            is_whole = not (by_map.is_biased or by_map.is_by_parts)
            return by_map if is_whole else by_map.refuse(by_map.prediction.finding)
        if by_map.is_accepted or not is_trusted:
            return by_map
        return self._propagate(frame.images, by_map.prediction, by_map.finding) or by_map

    def start(self, candidate: PoseCandidate, stamp_ns: int) -> None:
        """Begin anew at an image that the map has placed."""
        if not (self.is_needed or candidate.is_by_range):
            by_contrast, ncc = candidate.choice.by_contrast, candidate.ncc
            usual = self._usual_ncc[by_contrast]
            self._usual_ncc[by_contrast] += (1.0 - IMAGE_FORGETTING) * (ncc - usual) if usual else ncc
        self._last, self._way = candidate, Way(candidate.T_map_camera, candidate.covariance, stamp_ns)

    def _propagate(self, images: Sequence[RigImage], prediction: Prediction, cause: Verdict) -> PoseCandidate | None:
        """Place images that the map does not place, `cause` says why; None where the last ones do not, or no longer."""
        last, way, limit = self._last, self._way, self._params.prior.max_blind_m
        if last is None or way is None or prediction.growth is None or prediction.blind_s > GAP_S:
            return None
        if way.meters > limit or prediction.stamp_ns - way.stamp_ns > VO_MAX_S * 1e9:
            return None
        as_before = replace(prediction, by_contrast=last.choice.by_contrast)
        chosen = self._references.choose_rig(images, as_before)
        registration = self._params.registration
        finest = max(find_finest_level(images, self._params), registration.pyramid.finest)
        registration = between(registration, finest=finest)
        seen = add_last(chosen, last, registration)
        if not seen:
            return None
        motion = prediction.frame_motion(self._params.camera.readout)
        found = register_rig(seen, prediction.T_map_camera, accept_any_mad(registration), motion, prediction.expected)
        if not is_step(found, prediction):
            return None
        step = found.T_world_camera
        way = way.add_step(last.T_map_camera, step, found.covariance)
        detail = f"{cause.detail}; by the last images alone for {way.meters:.1f} m of {limit:g}".removeprefix("; ")
        acceptance = Acceptance(is_accepted=True, is_good=False, finding=replace(cause, detail=detail), quality=0.0)
        evidence = prediction, chosen.choice, acceptance, found, motion, seen
        self._last, self._way = PoseCandidate(step, way.covariance_at(step), *evidence, is_by_map=False), way
        return self._last


def add_last(chosen: RigChoice, last: PoseCandidate, params: RegistrationParams) -> tuple[RigImage, ...]:
    """Return images with the key spheres that cover them and the last image of the same camera."""
    before, seen = {image.name: image for image in last.images}, []
    for image in chosen.images:
        if image.name in before:
            view = make_view(before[image.name], last.T_map_camera, share_pixels(params, len(last.images)))
            seen.append(replace(image, views=(*image.views[: MAX_VIEWS - 1], view)))
    return tuple(seen)


def make_view(image: RigImage, T_world_body: SE3, params: RegistrationParams) -> View:
    """Return an image that was placed as a reference, with the range of its own references."""
    range_m, seen = warp_range(image, T_world_body, params), image.pyramid.images[0]
    if np.isnan(seen).any():  # cells that never show the map
        range_m[cv2.dilate(np.isnan(seen).astype(np.uint8), np.ones((3, 3))) > 0] = np.nan
        seen = np.nan_to_num(seen)
    reference = prepare_reference(seen, range_m, image.pyramid.cameras[0], params)
    return View(reference, image.pose(T_world_body))


def warp_range(image: RigImage, T_world_body: SE3, params: RegistrationParams) -> NDArray[np.float32]:
    """Return the range (H, W) in m along the rays of an image at a pose, NaN where no reference has it.

    It is known at the pixels that an alignment would choose; the nearest point of a pixel counts.
    """
    level = image.pyramid.levels[0]
    camera, T_camera_world = level.camera, image.pose(T_world_body).inverse()
    range_m = np.full((camera.height, camera.width), np.nan, np.float32)
    for view in image.views:
        T_camera_reference = T_camera_world @ view.T_world_reference
        pixels = view.reference.level_like(camera)
        selection = choose_pixels(pixels, T_camera_reference, camera, params.max_pixels // len(image.views))
        rows = selection.blocks.reshape(-1, BLOCK // SIDE, SIDE)[:, :3].transpose(1, 0, 2).reshape(3, -1)
        points = T_camera_reference.apply(rows[:, ~np.isnan(rows[2])].T.astype(np.float64))
        uv, is_visible = camera.project(points)
        column, row = np.rint(uv[is_visible]).astype(np.int64).T
        distance = np.linalg.norm(points[is_visible], axis=1).astype(np.float32)
        inside = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
        column, row, distance = column[inside], row[inside], distance[inside]
        np.fmin.at(range_m, (row, column), np.where(distance < params.far, distance, np.inf))
    return range_m


def is_step(found: Alignment, prediction: Prediction) -> bool:
    """Say whether an alignment with the last image is sure of the step: alike, determined, and one that can be."""
    if found.reason or prediction.growth is None or found.ncc < MIN_EXPLAINED_NCC:
        return False
    if measure_position_sigma(found.covariance) > VO_MAX_SIGMA_M:
        return False
    both = prediction.growth + found.covariance
    return squared_distance(prediction.T_map_camera, found.T_world_camera, both) <= MAX_INNOVATION**2


def find_finest_level(images: Sequence[RigImage], params: LocalizerParams) -> int:
    """Return the finest level of which a reference is made: a camera of 45 Hz cannot wait for that of a full image."""
    limit = MAX_LEVEL_PIXELS * params.registration.max_pixels
    sizes = [
        max(camera.width * camera.height for camera in level)
        for level in zip(*(image.pyramid.cameras for image in images), strict=False)
    ]
    return next((index for index, size in enumerate(sizes) if size <= limit), len(sizes) - 1)


@cache
def accept_any_mad(params: RegistrationParams) -> RegistrationParams:
    """Return the parameters without a limit of the residuals: references count by the inverse of theirs."""
    return replace(params, max_mad=np.inf)
