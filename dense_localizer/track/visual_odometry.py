"""Where the map does not fit, the last image does: one more reference in the same alignment (M15 section 5.3).

Its grey levels are of now, so that a lamp that was switched, a saturated wall or a hidden part of the map cost nothing
beyond one image; its range is that of the key spheres, seen from where it was taken. What is found so drifts: the
covariance grows with the way, and after a stated distance the pose is lost.

The range of an image that has none, by the references it was aligned with: the warped depth of M15 section 5.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from dense_localizer.judge.acceptance import Verdict
from dense_localizer.judge.place import Place, first_level, join
from dense_localizer.motion_prior import Prediction, sigma_m
from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import Choice, References
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import Finding
from sphere_nav.photometric import Alignment, RegistrationParams, View, prepare_reference
from sphere_nav.photometric.align.esm import register_rig
from sphere_nav.photometric.align.iteration.kernels import BLOCK, SIDE
from sphere_nav.photometric.align.problem import MAX_VIEWS
from sphere_nav.photometric.align.rig import RigImage, share_pixels
from sphere_nav.photometric.checks.structure import Aspect, find_rig_structure
from sphere_nav.photometric.pixels.selection import choose


def range_of_view(image: RigImage, T_world_body: SE3, params: RegistrationParams) -> NDArray[np.float32]:
    """Return the range (H, W) in m along the rays of an image at a pose, NaN where no reference tells it.

    It is known at the pixels that an alignment would choose; the nearest point of a pixel counts.
    """
    level = image.pyramid.levels[0]
    camera, T_camera_world = level.camera, image.pose(T_world_body).inverse()
    range_m = np.full((camera.height, camera.width), np.nan, np.float32)
    for view in image.views:
        T_camera_reference = T_camera_world @ view.T_world_reference
        pixels = view.reference.level_like(camera)
        selection = choose(pixels, T_camera_reference, camera, params.max_pixels // len(image.views))
        rows = selection.blocks.reshape(-1, BLOCK // SIDE, SIDE)[:, :3].transpose(1, 0, 2).reshape(3, -1)
        points = T_camera_reference.apply(rows[:, ~np.isnan(rows[2])].T.astype(np.float64))
        uv, is_visible = camera.project(points)
        column, row = np.rint(uv[is_visible]).astype(np.int64).T
        distance = np.linalg.norm(points[is_visible], axis=1).astype(np.float32)
        inside = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
        column, row, distance = column[inside], row[inside], distance[inside]
        np.fmin.at(range_m, (row, column), np.where(distance < params.far, distance, np.inf))
    return range_m


Array = NDArray[np.float64]
DRIFT_M, DRIFT_RAD = 0.02, 0.004  # standard deviation of what drifts, for each metre of the way
MAX_SECONDS = 60.0  # by the last image alone
MAX_STEP_S = 0.3  # between two images, which may be no farther apart
MIN_NCC, MAX_STEP_SIGMA_M, MAX_SIGMAS = 0.8, 0.02, 5.0  # of an alignment with the last image
# Where light changes from one image to the next, neither map nor last image fit. That the place is the same is seen by
# the gradients; one image then goes on by the prediction.
SAME_PLACE, MAX_PREDICTED = 0.3, 2  # mean cosine; images in a row
NEARLY, KEPT = 0.9, 0.9  # of the usual correlation with the map; of its weight, from one image to the next
MIN_SIGMA_M, MIN_SIGMA_RAD = 0.005, 0.002  # of any comparison
MAX_LEVEL_PIXELS = 2.0  # of the pixels that are aligned: to make a reference of more takes longer than to align it
ANY_MAD = 255.0  # the map may differ as it likes: each reference counts by the inverse of its own residuals


@dataclass(frozen=True)
class Way:
    """The way since the map was last sure: the pose there and its covariance (6, 6), and the noise (6, 6) of steps."""

    T_map_start: SE3
    covariance: Array
    stamp_ns: int
    metres: float = 0.0
    noise: Array | None = None

    def go(self, T_map_before: SE3, T_map_now: SE3, noise: Array) -> Way:
        """Return the way with one more step, whose alignment has a covariance (6, 6)."""
        T_now_before = T_map_now.inverse() @ T_map_before
        if self.noise is not None:
            Ad = T_now_before.adjoint()
            noise = noise + Ad @ self.noise @ Ad.T
        step = float(np.linalg.norm(T_now_before.translation))
        return replace(self, metres=self.metres + step, noise=noise)

    def covariance_at(self, T_map_now: SE3) -> Array:
        """Return the covariance (6, 6) of the pose at its end: of the start, of the steps, and of what they share."""
        Ad = (T_map_now.inverse() @ self.T_map_start).adjoint()
        drift = np.diag(np.repeat([DRIFT_M * self.metres, DRIFT_RAD * self.metres], 3) ** 2)
        noise = np.zeros((6, 6)) if self.noise is None else self.noise
        return Ad @ self.covariance @ Ad.T + noise + drift


class VisualOdometry:
    """Keeps the last image that was placed."""

    def __init__(self, references: References, params: LocalizerParams) -> None:
        self._references, self._params = references, params
        self.forget()

    def forget(self) -> None:
        """Nothing is known of the past."""
        self._last: Place | None = None
        self._way: Way | None = None
        self._num_predicted = 0  # images in a row
        self.usual_ncc = 0.0  # of images and map

    def start(self, place: Place, stamp_ns: int) -> None:
        """Begin anew at an image that the map has placed."""
        if not self.is_needed:
            self.usual_ncc += (1.0 - KEPT) * (place.ncc - self.usual_ncc) if self.usual_ncc else place.ncc
        self._last, self._way = place, Way(place.T_map_camera, place.covariance, stamp_ns)
        self._num_predicted = 0

    @property
    def is_needed(self) -> bool:
        """Whether the last images were not placed by the map."""
        return self._way is not None and self._way.metres > 0.0

    def supports(self, place: Place, other: Place | None) -> bool:
        """Say whether a place by the map, after images without it, is one to believe.

        It is where the last images place it (`other`; None: nowhere), but for their drift, or it resembles the map
        nearly as places did before.
        """
        if self._way is None or place.ncc >= NEARLY * self.usual_ncc:
            return True
        if other is None:
            return False
        xi = (other.T_map_camera.inverse() @ place.T_map_camera).log()
        sigma = np.repeat([MIN_SIGMA_M + DRIFT_M * self._way.metres, MIN_SIGMA_RAD + DRIFT_RAD * self._way.metres], 3)
        return float(np.sum((xi / sigma) ** 2)) <= MAX_SIGMAS**2

    def propagate(self, images: Sequence[RigImage], prediction: Prediction, cause: Finding) -> Place | None:
        """Place images that the map does not place, `cause` says why; None where the last ones do not, or no longer."""
        last, way, limit = self._last, self._way, self._params.prior.max_blind_m
        if last is None or way is None or prediction.growth is None or prediction.blind_s > MAX_STEP_S:
            return None
        if way.metres > limit or prediction.stamp_ns - way.stamp_ns > MAX_SECONDS * 1e9:
            return None
        choices = [
            self._references.choose(one.pose(prediction.T_map_camera), one.pyramid.cameras[0], is_followed=True)
            for one in images
        ]
        registration = no_finer(self._params.registration, finest_level(images, self._params))
        seen = self._with_last(images, choices, last, registration)
        if not seen:
            return None
        motion = prediction.frame_motion(self._params.camera.readout)
        found = register_rig(seen, prediction.T_map_camera, any_mad(registration), motion)
        step, noise = found.T_world_camera, found.covariance
        self._num_predicted = 0 if is_step(found, prediction) else self._num_predicted + 1
        if self._num_predicted:
            level = first_level(prediction, join(choices), seen[0].pyramid, self._params)
            if (
                self._num_predicted > MAX_PREDICTED
                or agreement_at(seen, found, prediction, level, self._params) < SAME_PLACE
            ):
                return None
            step, noise = prediction.T_map_camera, prediction.growth
        way = way.go(last.T_map_camera, step, noise)
        detail = f"{cause.detail}; by the last images alone for {way.metres:.1f} m of {limit:g}".removeprefix("; ")
        verdict = Verdict(is_accepted=True, is_good=False, finding=replace(cause, detail=detail), quality=0.0)
        found = replace(found, T_world_camera=step, covariance=noise)
        place = Place(step, way.covariance_at(step), join(choices), verdict, found, motion, seen)
        self._last, self._way = place, way
        return place

    @staticmethod
    def _with_last(
        images: Sequence[RigImage], choices: Sequence[Choice], last: Place, params: RegistrationParams
    ) -> tuple[RigImage, ...]:
        """Return images with the key spheres that cover them and the last image of the same camera."""
        before, seen = {image.name: image for image in last.images}, []
        for image, choice in zip(images, choices, strict=True):
            if image.name in before:
                view = view_of(before[image.name], last.T_map_camera, share_pixels(params, len(last.images)))
                seen.append(replace(image, views=(*choice.views[: MAX_VIEWS - 1], view)))
        return tuple(seen)


def view_of(image: RigImage, T_world_body: SE3, params: RegistrationParams) -> View:
    """Return an image that was placed as a reference, with the range that its own references tell."""
    range_m = range_of_view(image, T_world_body, params)
    reference = prepare_reference(image.pyramid.images[0], range_m, image.pyramid.cameras[0], params)
    return View(reference, image.pose(T_world_body))


def is_step(found: Alignment, prediction: Prediction) -> bool:
    """Say whether an alignment with the last image is sure of the step: alike, determined, and one that can be."""
    if found.reason or prediction.growth is None or found.ncc < MIN_NCC or sigma_m(found.covariance) > MAX_STEP_SIGMA_M:
        return False
    xi = (prediction.T_map_camera.inverse() @ found.T_world_camera).log()
    return float(xi @ np.linalg.solve(prediction.growth + found.covariance, xi)) <= MAX_SIGMAS**2


def agreement_at(
    seen: Sequence[RigImage], found: Alignment, prediction: Prediction, level: int, params: LocalizerParams
) -> float:
    """Return the mean cosine of gradients at the predicted pose, at a level where its uncertainty is about a pixel."""
    coarsest = min(len(image.pyramid.levels) for image in seen) - 1
    registration = replace(
        params.registration, pyramid=replace(params.registration.pyramid, finest=min(level, coarsest))
    )
    there = replace(found, T_world_camera=prediction.T_map_camera)
    return find_rig_structure(seen, there, registration, aspects=Aspect.FIT).agreement


def finest_level(images: Sequence[RigImage], params: LocalizerParams) -> int:
    """Return the finest level of which a reference is made: a camera of 45 Hz cannot wait for that of a full image."""
    limit = MAX_LEVEL_PIXELS * params.registration.max_pixels
    sizes = [
        max(camera.width * camera.height for camera in level)
        for level in zip(*(image.pyramid.cameras for image in images), strict=False)
    ]
    return next((index for index, size in enumerate(sizes) if size <= limit), len(sizes) - 1)


@cache
def no_finer(params: RegistrationParams, level: int) -> RegistrationParams:
    """Return the parameters of an alignment that ends at a level, or at a coarser one."""
    pyramid = params.pyramid
    finest = max(level, pyramid.finest)
    return replace(params, pyramid=replace(pyramid, finest=finest, coarsest=max(finest, pyramid.coarsest)))


@cache
def any_mad(params: RegistrationParams) -> RegistrationParams:
    """Return the parameters without a limit of the residuals."""
    return replace(params, max_mad=ANY_MAD)
