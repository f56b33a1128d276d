"""One attempt to place the images of an instant: choose references, align, judge; for tracking and for the start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from dense_localizer.judge.acceptance import Verdict, judge, refusal
from dense_localizer.motion_prior import MAX_SIGMA_M, Prediction, sigma_m
from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import MIN_VISIBLE_SHARE, Choice, References
from sphere_nav.geometry import SE3, FrameMotion
from sphere_nav.localization.status import Finding, Reason
from sphere_nav.photometric import Alignment, Pyramid, RegistrationParams
from sphere_nav.photometric.align.esm import register_rig
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.photometric.checks.bias import PoseBias
from sphere_nav.photometric.checks.structure import EVERYTHING, Aspect, find_rig_structure
from sphere_nav.photometric.constants import GRADIENT_SHARE, OCCLUSION_SHARE

USUALLY = 0.97  # of the usual correlation, below which an image is looked at closely
LEFT = 0.2  # standard deviation of what is left of a pull when it is taken back, as share of it
LEVEL_SIGMAS = 1.0  # uncertainty of the prediction that the first level must cover
UNKNOWN = np.diag(np.full(6, np.inf))


@dataclass(frozen=True)
class Place:
    """A pose with its covariance (6, 6), the references behind it and the verdict. No alignment: nothing to see.

    `images` are those that some reference covers, with their references.
    """

    T_map_camera: SE3
    covariance: NDArray[np.float64]
    choice: Choice
    verdict: Verdict
    alignment: Alignment | None = None
    motion: FrameMotion | None = None  # within the frame
    images: tuple[RigImage, ...] = ()
    is_pulled: bool = False  # by a hidden part of the view, or by uneven light, where that was looked at: taken back

    @property
    def is_rig(self) -> bool:
        """Whether the pose is that of a body which carries the cameras, not that of the one camera."""
        return len(self.images) != 1 or self.images[0].T_body_camera is not None

    @property
    def noise(self) -> NDArray[np.float64]:
        """The part (6, 6) of the covariance that the image brings, not the map."""
        return self.alignment.covariance if self.alignment is not None else self.covariance

    @property
    def is_certain(self) -> bool:
        """Whether the position is known well enough to go on from."""
        return sigma_m(self.covariance) <= MAX_SIGMA_M

    @property
    def ncc(self) -> float:
        """How well the references explain the image, -1...1."""
        return self.alignment.ncc if self.alignment is not None else -1.0


def locate(
    images: Sequence[RigImage],
    references: References,
    params: LocalizerParams,
    T_map_camera: SE3,
    prediction: Prediction | None = None,
    asked: Aspect = EVERYTHING,
    usual_ncc: float = 0.0,
) -> Place:
    """Place images from a first guess of their pose (M15 eq. 17-19); every jump is allowed without a prediction.

    Residuals are `asked` some of what they tell; all of it where the images resemble the map less than usual.
    """
    followed = prediction is not None
    choices = [
        references.choose(one.pose(T_map_camera), one.pyramid.levels[0].camera, is_followed=followed) for one in images
    ]
    seen = tuple(replace(one, views=c.views) for one, c in zip(images, choices, strict=True) if c.views)
    choice = join(choices)
    if not seen:
        limit, detail = MIN_VISIBLE_SHARE, "no key sphere covers the view"
        verdict = refusal(Finding(Reason.LOW_OVERLAP, choice.overlap, limit, detail))
        return Place(T_map_camera, UNKNOWN, choice, verdict)
    registration: RegistrationParams = params.registration
    if prediction is not None and not prediction.is_doubtful:
        registration = starting_at(first_level(prediction, choice, seen[0].pyramid, params), registration)
    motion = prediction.frame_motion(params.camera.readout) if prediction is not None else None
    alignment = register_rig(seen, T_map_camera, registration, motion)
    structure, pulls, left = None, list[PoseBias](), np.zeros((6, 6))
    asked = EVERYTHING if alignment.ncc < USUALLY * usual_ncc else asked
    if alignment.is_converged and asked:
        structure = find_rig_structure(seen, alignment, registration, motion, asked)
        pulls = [structure.occlusion] if structure.occlusion.share >= OCCLUSION_SHARE else []
        pulls += [structure.illumination] if structure.illumination.share >= GRADIENT_SHARE else []
        alignment, left = take_back(alignment, pulls)
    covariance = alignment.covariance + left + _map_covariance(references, choice, alignment.T_world_camera)
    limits = params.acceptance, params.registration.max_mad
    verdict = judge(alignment, covariance, choice.distance_ratio, prediction, *limits, structure)
    pose = alignment.T_world_camera
    return Place(pose, covariance, choice, verdict, alignment, motion, seen, bool(pulls))


def take_back(alignment: Alignment, pulls: Sequence[PoseBias]) -> tuple[Alignment, NDArray[np.float64]]:
    """Return the alignment less what pulls it, one after the other, and the covariance (6, 6) of what may be left."""
    pose, left = alignment.T_world_camera, np.zeros((6, 6))
    for pull in pulls:
        pose, left = pose @ SE3.exp(pull.xi), left + np.diag(np.repeat(LEFT * np.array(pull.lengths), 3) ** 2)
    return replace(alignment, T_world_camera=pose), left


def join(choices: Sequence[Choice]) -> Choice:
    """Return the references of several cameras together, with range, region and distance of the nearest."""
    if len(choices) == 1:
        return choices[0]
    nearest = min(choices, key=lambda choice: choice.distance_m)
    ids = tuple(dict.fromkeys(sphere_id for choice in choices for sphere_id in choice.ids))
    views = tuple(view for choice in choices for view in choice.views)
    return replace(nearest, ids=ids, views=views, overlap=max(choice.overlap for choice in choices))


def _map_covariance(references: References, choice: Choice, T_map_camera: SE3) -> NDArray[np.float64]:
    """Return the covariance (6, 6) of a pose by the errors of the map."""
    T_map_sphere = choice.views[0].T_world_reference
    return references.error.covariance(choice.ids[0], T_map_sphere.inverse() @ T_map_camera)


def first_level(prediction: Prediction, choice: Choice, pyramid: Pyramid, params: LocalizerParams) -> int:
    """Return the coarsest level needed: the one at which the uncertainty of the prediction is about a pixel."""
    deviation = np.sqrt(np.diagonal(prediction.covariance))
    angle = np.max(deviation[3:]) + np.max(deviation[:3]) / choice.typical_range_m
    pixels = LEVEL_SIGMAS * angle * pyramid.levels[0].camera.pixels_per_radian
    return max(0, int(np.ceil(np.log2(max(pixels, 1.0)))))


@cache
def starting_at(level: int, params: RegistrationParams) -> RegistrationParams:
    """Return the parameters of an alignment that begins at a level."""
    return replace(params, pyramid=replace(params.pyramid, coarsest=min(level, params.pyramid.coarsest)))
