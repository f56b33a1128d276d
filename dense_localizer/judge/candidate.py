"""A pose that images may have been taken from, with all that speaks for and against it: is it accepted?

Every check gives reason, value and limit; one failed check refuses the result. What decides is evidence: does the image
resemble the map, do the pixels agree, is the pose determined, is it where it can be. A change of light or the distance
to a key sphere is none, however large: it may only be named as the cause.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dense_localizer.constants import (
    ACCEPTED_INLIER_SHARE,
    GOOD_AGREEMENT_LEAD,
    GOOD_INLIER_SHARE,
    GOOD_NCC_LEAD,
    GOOD_OVERLAP,
    GOOD_RANGE_AGREEMENT,
    GOOD_RANGE_OVERLAP,
    GOOD_SIGMA,
    MAX_ATTITUDE_SIGMA_RAD,
    MAX_INNOVATION,
    MAX_POSITION_SIGMA_M,
    MIN_GRADIENT_AGREEMENT,
    MIN_OVERLAP,
    NOTABLE_GAIN,
    NOTABLE_OFFSET,
    REMAINING_BIAS,
)
from dense_localizer.motion_prior import Prediction, measure_position_sigma
from dense_localizer.params import AcceptanceParams
from dense_localizer.references.reference import Choice
from sphere_nav.geometry import SE3, FrameMotion
from sphere_nav.geometry.arrays import Array
from sphere_nav.localization.constants import PROVEN_IMAGES
from sphere_nav.localization.status import FINE, Reason, Verdict
from sphere_nav.photometric import Alignment
from sphere_nav.photometric.align.problem import RigImage
from sphere_nav.photometric.checks.structure import Structure
from sphere_nav.photometric.constants import OCCLUSION_SHARE
from sphere_nav.spheres.constants import MIN_RANGE_AGREEMENT, MIN_RANGE_OVERLAP
from sphere_nav.spheres.range_alignment import RangeFit


@dataclass(frozen=True)
class Acceptance:
    """`is_accepted`: the pose may be used; `is_good`: without care. `finding` names the worst fact."""

    is_accepted: bool
    is_good: bool
    finding: Verdict
    quality: float


@dataclass(frozen=True)
class Check:
    """A measured value between its limits: refused beyond `hard`, used with care beyond `good`."""

    reason: Reason
    value: float
    hard: float
    good: float
    detail: str = ""

    @property
    def margin(self) -> float:
        """Return 0 at the hard limit, 1/2 at the good one, 1 as far again beyond it; NaN counts as failed."""
        span = self.good - self.hard
        if not np.isfinite(self.value):
            return -1.0
        if span == 0.0:  # a lower bound without a range of care
            return 1.0 if self.value >= self.hard else -1.0
        return min((self.value - self.hard) / (2.0 * span), 1.0)

    @property
    def finding(self) -> Verdict:
        """Return the reason with the limit that was broken."""
        return Verdict(self.reason, float(self.value), self.hard if self.margin < 0 else self.good, self.detail)


def assess(
    alignment: Alignment,
    covariance: Array,
    choice: Choice,
    prediction: Prediction,
    params: AcceptanceParams,
    max_mad: float = np.inf,
    structure: Structure | None = None,
) -> Acceptance:
    """Assess one alignment with its honest covariance.

    `choice` is that of its references, `max_mad` the limit of the alignment, `structure` that of its residuals where it
    was checked. Local contrast of a followed camera is good as soon as it is not refused.
    """
    if alignment.reason:
        return refuse(_explain_refusal(alignment, params, max_mad))
    if not (np.all(np.isfinite(alignment.T_world_camera.matrix)) and np.all(np.isfinite(covariance))):
        return refuse(Verdict(Reason.NO_CONVERGENCE, detail="the result is no number"))
    # Contrast needs no lead to be good: of 244 alignments that ended more than 0.3 m off in simulated towns none had an
    # agreement of 0.09 or a correlation of 0.3 (docs/notes/contrast.md).
    lead = 0.0 if choice.by_contrast and not prediction.is_guess else 1.0
    is_proven = structure is not None and structure.support.is_proven
    checks = _check_images(alignment, params, lead, is_proven=is_proven)
    if structure is not None:
        checks += _check_structure(structure, params, lead)
    acceptance = _conclude(checks + _check_pose(alignment.T_world_camera, covariance, prediction, params))
    if acceptance.is_good:
        return acceptance
    return replace(acceptance, finding=_name_cause(acceptance.finding, alignment, choice.distance_ratio))


def assess_range(
    fit: RangeFit, T_map_camera: SE3, covariance: Array, prediction: Prediction, params: AcceptanceParams
) -> Acceptance:
    """Assess a pose by range alone; what both ways must agree on has been asked (`measure_motion_by_ranges`)."""
    checks = [
        Check(Reason.LOW_OVERLAP, fit.overlap, MIN_RANGE_OVERLAP, GOOD_RANGE_OVERLAP, "of range and map"),
        Check(Reason.OUTLIERS, fit.agreement, MIN_RANGE_AGREEMENT, GOOD_RANGE_AGREEMENT, "of surfaces"),
    ]
    return _conclude(checks + _check_pose(T_map_camera, covariance, prediction, params))


def refuse(finding: Verdict) -> Acceptance:
    """Return that a result is not used, and why."""
    return Acceptance(is_accepted=False, is_good=False, finding=finding, quality=0.0)


def _explain_refusal(alignment: Alignment, params: AcceptanceParams, max_mad: float) -> Verdict:
    """Return the finding of an alignment that refuses itself, with the value that belongs to its reason."""
    explained = {
        Reason.LOW_OVERLAP: (alignment.overlap, MIN_OVERLAP, ""),
        Reason.LOW_TEXTURE: (alignment.num_pixels, params.min_pixels, "pixels that fix the pose"),
        Reason.OUTLIERS: (alignment.mad, max_mad, "median deviation in grey levels"),
        Reason.NO_CONVERGENCE: (alignment.iterations, alignment.iterations, "iterations"),
    }
    reason = Reason(alignment.reason)
    value, limit, detail = explained.get(reason, (0.0, 0.0, ""))
    return Verdict(reason, float(value), float(limit), detail)


def _check_images(alignment: Alignment, params: AcceptanceParams, lead: float, *, is_proven: bool) -> list[Check]:
    """Return the checks of how well the images agree with the map; `lead`: share of that which is asked of a good one.

    Where the parts of the view have proven the pose, the whole of it only says how much has changed.
    """
    seen = [
        Check(Reason.LOW_OVERLAP, alignment.overlap, MIN_OVERLAP, GOOD_OVERLAP),
        Check(Reason.LOW_TEXTURE, alignment.num_pixels, params.min_pixels, params.min_pixels, "pixels aligned"),
    ]
    if is_proven:
        return seen
    return [
        *seen,
        Check(Reason.OUTLIERS, alignment.inlier_share, ACCEPTED_INLIER_SHARE, GOOD_INLIER_SHARE),
        Check(
            Reason.OUTLIERS,
            alignment.ncc,
            params.min_ncc,
            params.min_ncc + lead * GOOD_NCC_LEAD,
            "correlation with the map",
        ),
    ]


def _check_structure(structure: Structure, params: AcceptanceParams, lead: float) -> list[Check]:
    """Return the checks of what the residuals look like; `lead`: share of that which is asked of a good one."""
    biases = _check_bias(structure, params)
    if structure.support.is_proven:  # a part of the view may have changed
        return biases
    limits = MIN_GRADIENT_AGREEMENT, MIN_GRADIENT_AGREEMENT + lead * GOOD_AGREEMENT_LEAD
    return [Check(Reason.OUTLIERS, structure.agreement, *limits, "agreement of gradients"), *biases]


def _check_bias(structure: Structure, params: AcceptanceParams) -> list[Check]:
    """Return the checks of whether an occlusion biased the pose by more than it may be uncertain.

    The bias is removed; only one of which too much may remain is refused.
    """
    bias = structure.occlusion
    if bias.share < OCCLUSION_SHARE:
        return []
    meters, radians = bias.lengths
    detail = f"by which a part of the view that is hidden pulled the pose, {bias.share:.0%} of the texture"
    return [
        Check(Reason.OUTLIERS, value, limit / REMAINING_BIAS, GOOD_SIGMA * limit, f"{unit} {detail}")
        for value, limit, unit in ((meters, params.max_sigma_m, "m"), (radians, MAX_ATTITUDE_SIGMA_RAD, "rad"))
    ]


def _name_cause(finding: Verdict, alignment: Alignment, distance_ratio: float) -> Verdict:
    """Return the finding; that of outliers by their likely cause, with the value that was judged."""
    gain = max((max(g, 1.0 / g) if g > 0 else np.inf for g in alignment.gains), default=1.0)
    bias = max((abs(b) for b in alignment.biases), default=0.0)
    if finding.reason is not Reason.OUTLIERS:
        return finding
    if gain > NOTABLE_GAIN or bias > NOTABLE_OFFSET:
        detail = f"{finding.detail}; gain {gain:.2g}, bias {bias:.0f} grey levels".removeprefix("; ")
        return replace(finding, reason=Reason.LIGHT_CHANGE, detail=detail)
    if distance_ratio > 1.0:
        detail = f"{finding.detail}; {distance_ratio:.2g} times the region of the key sphere away".removeprefix("; ")
        return replace(finding, reason=Reason.OUTSIDE_REGION, detail=detail)
    return finding


def _check_pose(T_map_camera: SE3, covariance: Array, prediction: Prediction, params: AcceptanceParams) -> list[Check]:
    """Return the checks of how far a pose is from its prediction, and how certain it is with what that knows.

    From a guess every jump is allowed.
    """
    distance = 0.0 if prediction.is_guess else prediction.distance(T_map_camera, covariance)
    if distance > MAX_INNOVATION:
        return [Check(Reason.JUMP_REJECTED, distance, MAX_INNOVATION, 0.0, "standard deviations from prediction")]
    certainty = _check_certainty(covariance, params)
    if _conclude(certainty).is_good:  # joining costs as much as all these checks
        return certainty
    return _check_certainty(prediction.join(T_map_camera, covariance)[1], params)


def _conclude(checks: Sequence[Check]) -> Acceptance:
    """Return what the worst of the checks makes of all."""
    worst = min(checks, key=lambda check: check.margin)
    is_accepted, is_good = bool(worst.margin >= 0.0), bool(worst.margin >= 0.5)
    return Acceptance(is_accepted, is_good, FINE if is_good else worst.finding, max(0.0, worst.margin))


def _check_certainty(covariance: Array, params: AcceptanceParams) -> list[Check]:
    """Return the checks of how well the view fixes the pose: its largest standard deviations."""
    sigma_m = np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1])
    sigma_rad = np.sqrt(np.linalg.eigvalsh(covariance[3:, 3:])[-1])
    max_m, max_rad = params.max_sigma_m, MAX_ATTITUDE_SIGMA_RAD
    return [
        Check(Reason.LOW_TEXTURE, sigma_m, max_m, GOOD_SIGMA * max_m, "uncertain position"),
        Check(Reason.LOW_TEXTURE, sigma_rad, max_rad, GOOD_SIGMA * max_rad, "uncertain attitude"),
    ]


@dataclass(frozen=True)
class PoseCandidate:
    """A pose with its covariance (6, 6), the prediction and references behind it, and whether it is accepted.

    No alignment: nothing to see. `images` are those that some reference covers, with their references.
    """

    T_map_camera: SE3
    covariance: NDArray[np.float64]
    prediction: Prediction
    choice: Choice
    acceptance: Acceptance
    alignment: Alignment | None = None
    motion: FrameMotion | None = None  # within the frame
    images: tuple[RigImage, ...] = ()
    is_biased: bool = False  # by an occlusion, uneven light or changes, where that was checked; the bias is removed
    is_by_map: bool = True  # else by the last images alone
    is_by_range: bool = False  # by geometry alone
    is_by_parts: bool = False  # parts of the view have proven it, however little the whole resembles the map
    is_proven: bool = False  # so many parts agree that the place is right, where they were asked

    def refuse(self, finding: Verdict) -> PoseCandidate:
        """Return it as one that is not used."""
        return replace(self, acceptance=refuse(finding))

    def join(self) -> PoseCandidate:
        """Return it with the pose that it and its prediction make together; one by the last images has it in it."""
        if not self.is_by_map:
            return self
        T_map_camera, covariance = self.prediction.join(self.T_map_camera, self.covariance)
        return replace(self, T_map_camera=T_map_camera, covariance=covariance)

    @property
    def is_accepted(self) -> bool:
        """Whether the pose may be used."""
        return self.acceptance.is_accepted

    @property
    def finding(self) -> Verdict:
        """The worst fact against it."""
        return self.acceptance.finding

    @property
    def is_rig(self) -> bool:
        """Whether the pose is that of a body which carries the cameras, not that of the one camera."""
        return len(self.images) != 1 or self.images[0].T_body_camera is not None

    @property
    def num_images(self) -> int:
        """How many images it counts for on probation."""
        return PROVEN_IMAGES if self.is_proven else 1

    @property
    def noise(self) -> NDArray[np.float64]:
        """The part (6, 6) of the covariance that the image brings, not the map."""
        return self.alignment.covariance if self.alignment is not None and not self.is_by_range else self.covariance

    @property
    def is_certain(self) -> bool:
        """Whether the position is known well enough to go on from."""
        return measure_position_sigma(self.covariance) <= MAX_POSITION_SIGMA_M

    @property
    def ncc(self) -> float:
        """How well the references explain the image, -1...1."""
        return self.alignment.ncc if self.alignment is not None and not self.is_by_range else -1.0
