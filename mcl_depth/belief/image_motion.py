"""Does the camera move as odometry says? The images tell, and what they tell is held against odometry.

The last image that was compared with the map, levelled, with the range that the map has where it was taken, is a
reference as a key sphere is one (M15 section 2.1); the image of now is aligned with it directly. So wheels that stand
while the vehicle is pushed, or that slip, are seen within an image or two, and an image that cannot be aligned is that
of a vehicle that was carried off.

Odometry and images are independent, so the square of their difference by both covariances is chi^2 of three degrees of
freedom while neither is broken: a contradiction is what exceeds its quantile. Where they agree, their weighted mean is
the motion; where they do not, it is that of the images, as far as they could be aligned well.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from mcl_depth.belief.estimate import Observation
from mcl_depth.belief.motion_model import (
    Step,
    blind_step,
    compose_planar,
    motion_sigmas,
    odometry_step,
    planar_pose,
    relative_motion,
    way_of,
    wrap_angle,
)
from mcl_depth.constants import (
    IMAGE_DRIFT,
    IMAGE_SIGMA,
    MAX_REACH,
    MIN_MOUNTING_ERROR,
    MIN_NCC,
    SHARP_M,
    WHEEL_SIGMA,
)
from mcl_depth.likeness.depth_map import DepthMap
from mcl_depth.params import MotionParams
from sphere_nav.estimation.least_squares import gate, squared_mahalanobis
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import PLANAR, Array
from sphere_nav.localization.status import FINE, Reason, Verdict
from sphere_nav.photometric import PyramidParams, RegistrationParams, View, build_pyramid, prepare_reference, register

REMEDY = "check the wheels, who resets odometry, and whether the vehicle was carried"
REMEDY_MOUNTING = "check the yaw of the camera's mounting and the axes of odometry"
UNKNOWN_VARIANCE = 1e6  # m2, rad2
REGISTRATION = RegistrationParams(pyramid=PyramidParams(num_levels=4, min_side=12))


@dataclass(frozen=True)
class ImageStep:
    """Motion (3,) of `level` in its own axes: forward m, left m, yaw rad, with covariance (3, 3); how well it fits."""

    motion: Array
    covariance: Array
    ncc: float


@dataclass(frozen=True)
class Reconciled:
    """An observation with odometry that the images agree with, and what they had against it.

    `is_known`: the motion, by the images or as nothing is against odometry; `is_verified`: images confirm it.
    `hint`: what images of a place that is not held have against odometry.
    """

    observation: Observation
    finding: Verdict = FINE
    is_known: bool = True
    is_verified: bool = False
    hint: Verdict = FINE
    step: Step = field(default_factory=partial(blind_step, 0.0))  # since the image that is kept

    @property
    def is_contradicted(self) -> bool:
        """Whether the images show another motion."""
        return self.finding is not FINE


def measure_motion(view: View, observation: Observation, guess: Array) -> ImageStep:
    """Return the motion since an image, from a first guess (3,).

    One that was not found has no weight; how well the image fits there tells whether it is of another place.
    """
    image = observation.image if observation.image.dtype == np.uint8 else observation.image.astype(np.float32)
    pyramid = build_pyramid(image, observation.camera, REGISTRATION.pyramid)
    T_level_camera = SE3.from_parts(observation.rotation, np.zeros(3))
    T_before_level = SE3.from_planar(*guess)
    found = register(pyramid, [view], T_before_level @ T_level_camera, REGISTRATION)
    if not found.is_converged:
        return ImageStep(guess, np.diag(np.full(3, UNKNOWN_VARIANCE)), found.ncc)
    motion = planar_pose(found.T_world_camera @ T_level_camera.inverse())
    Ad = T_level_camera.adjoint()
    covariance = (Ad @ found.covariance @ Ad.T)[PLANAR] + image_covariance(way_of(motion))
    return ImageStep(motion, covariance, found.ncc)


def image_covariance(way: float) -> Array:
    """Return what the covariance (3, 3) of an alignment omits after a way in m: errors of range, tilt and traffic."""
    return np.diag(IMAGE_SIGMA**2 + (IMAGE_DRIFT * way) ** 2)


class ReconciledOdometry:
    """Holds odometry against the images; `reconcile` gives odometry that goes on as both say."""

    def __init__(self, depth_map: DepthMap, params: MotionParams) -> None:
        self._map, self._params = depth_map, params
        self.reset()

    def reset(self) -> None:
        """Begin with another stream of images and odometry."""
        self.forget()
        self._reference: tuple[Observation, Observation] | None = None  # the image that is kept: as it came, reconciled
        self._now: tuple[Observation, Observation] | None = None  # the same of the last image

    def forget(self) -> None:
        """Forget the image: odometry is believed until two of them are compared."""
        self._view: View | None = None  # of the image that is kept
        self._reach_m = 0.0
        self._follows = False  # the last image could be aligned with the one before

    def keep(self, gray: NDArray[np.float32], is_seen: NDArray[np.bool_], pose: Array | None) -> None:
        """Measure from the last image on, levelled (H, W), at a pose (3,) of the map; None: no place is held."""
        self._reference = self._now
        range_m = self._map.ranges_from(pose) if pose is not None else None
        self._view = None
        if range_m is not None:
            range_m[~is_seen] = np.nan
            finite = range_m[np.isfinite(range_m)]
            self._reach_m = MAX_REACH * float(np.median(finite)) if finite.size else 0.0
            reference = prepare_reference(gray, range_m, self._map.camera, REGISTRATION, keep_edges=True)
            self._view = View(reference, SE3.identity())

    def reconcile(self, observation: Observation, *, is_held: bool) -> Reconciled:
        """Return an observation with odometry that images and odometry agree on, and what they disagree on.

        The range around a place that is not held (`is_held`) is a guess: what images say with it is but a hint.
        """
        before, self._now = self._reference, (observation, observation)
        raw = observation.odometry
        if before is None:
            return Reconciled(observation, step=Step(np.zeros(3), np.zeros(3), is_known=raw is not None))
        kept, reconciled = before
        seconds = max((observation.stamp_ns - kept.stamp_ns) * 1e-9, 0.0)
        if raw is None or kept.odometry is None or reconciled.odometry is None:
            return Reconciled(observation, step=blind_step(seconds))
        motion = relative_motion(kept.odometry, raw)
        finding, fused, is_known, is_verified = self._compare(observation, motion)
        if is_held:
            motion = fused
        here = replace(observation, odometry=compose_planar(reconciled.odometry[None], motion)[0])
        self._now = observation, here
        step = odometry_step(motion, seconds, self._params)
        if not is_held:
            return Reconciled(here, hint=finding, step=step)
        return Reconciled(here, finding, is_known, is_verified, step=step if is_known else blind_step(seconds))

    def _compare(self, observation: Observation, motion: Array) -> tuple[Verdict, Array, bool, bool]:
        """Return what the images have against a motion (3,) by odometry, the motion by both, is_known, is_verified.

        An image that cannot be aligned says something only where the last one could; of a way that is long by what is
        seen an alignment says nothing: a room looks another from its other end.
        """
        if self._view is None or way_of(motion) > self._reach_m:
            return FINE, motion, True, False
        step = measure_motion(self._view, observation, motion)
        followed, self._follows = self._follows, step.ncc >= MIN_NCC
        if not self._follows and not followed:
            return FINE, motion, True, False
        if not self._follows:
            detail = "the image does not follow from the last one: correlation"
            return Verdict(Reason.JUMP_REJECTED, step.ncc, MIN_NCC, detail, REMEDY), motion, False, False
        C_odometry = np.diag(motion_sigmas(motion, self._params, WHEEL_SIGMA) ** 2)
        difference = step.motion - motion
        difference[2] = float(wrap_angle(difference[2]))
        square = squared_mahalanobis(difference, C_odometry + step.covariance)
        if square > gate(3, 1e-4):
            words, remedy = describe_difference(motion, step.motion)
            limit = float(np.sqrt(gate(3, 1e-4)))
            return Verdict(Reason.JUMP_REJECTED, float(np.sqrt(square)), limit, words, remedy), step.motion, True, False
        is_sharp = float(np.linalg.eigvalsh(step.covariance[:2, :2])[-1]) < SHARP_M**2
        return FINE, motion + C_odometry @ np.linalg.solve(C_odometry + step.covariance, difference), True, is_sharp


def describe_difference(motion: Array, seen: Array) -> tuple[str, str]:
    """Return how a motion (3,) by odometry and that by images differ, in words, and what to check."""
    words, remedy = f"odometry says {way_of(motion):.2f} m, the images {way_of(seen):.2f} m", REMEDY
    angle = float(wrap_angle(np.arctan2(seen[1], seen[0]) - np.arctan2(motion[1], motion[0])))
    if min(way_of(motion), way_of(seen)) > SHARP_M and abs(angle) > MIN_MOUNTING_ERROR:
        words, remedy = f"{words} at {np.degrees(angle):+.0f} deg to it", REMEDY_MOUNTING
    return f"{words}: sigmas", remedy
