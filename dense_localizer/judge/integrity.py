"""Is what was aligned the pose? Alignment, acceptance of each candidate, and integrity checks that look beyond one.

Each is an alignment to the references chosen for a prediction (M15 eq. 19), from the coarsest level that this needs.
Not every check is due for each image, but all while the pose is not trusted: does odometry agree
(`odometry_check.py`), what do the residuals look like (`photometric/checks/structure.py`), do the references agree
(`map_error.py`), is the lens right, is anything before it (`lens_watch.py`)?
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dense_localizer.constants import (
    CONTRAST_COVARIANCE,
    CORRELATED_CELLS,
    FIT_PHASE,
    FULL_CHECK_NCC,
    GOOD_OVERLAP,
    INNOVATION_RATE,
    INTEGRITY_PERIOD,
    MAP_PHASE,
    NUM_INNOVATIONS,
    NUM_OTHER_EXPERIENCES,
    OCCLUSION_PHASE,
    REMAINING_BIAS,
    SURE_GRAY_NCC,
)
from dense_localizer.inputs import LocalizerInput
from dense_localizer.judge.candidate import PoseCandidate, assess, refuse
from dense_localizer.judge.lens_watch import LensWatch, ViewMask
from dense_localizer.judge.odometry_check import OdometryCheck, OdometrySample
from dense_localizer.motion_prior import Prediction
from dense_localizer.params import LocalizerParams
from dense_localizer.references.coarse_reference import Tried
from dense_localizer.references.reference import Choice, References, RigChoice
from sphere_nav.estimation.least_squares import gate
from sphere_nav.geometry import SE3, FrameMotion
from sphere_nav.localization.status import FINE, TRUSTED, Reason, State, Verdict
from sphere_nav.photometric import Alignment, Pyramid, RegistrationParams
from sphere_nav.photometric.align.esm import GOOD, UNKNOWN, register_rig
from sphere_nav.photometric.align.problem import Expectation, RigImage
from sphere_nav.photometric.checks.structure import (
    EVERYTHING,
    NOTHING,
    Aspect,
    PoseBias,
    Structure,
    Support,
    find_rig_structure,
)
from sphere_nav.photometric.constants import MAX_PREDICTED_CHANCE, OCCLUSION_SHARE
from sphere_nav.photometric.params import between
from sphere_nav.photometric.parts.registration import register_parts

# All checks of one image take as long as to align it: no two in the same one.
CHECKS_DUE = {FIT_PHASE: Aspect.FIT, OCCLUSION_PHASE: Aspect.OCCLUSION}


class Integrity:
    """Assesses candidates by themselves, and by what earlier images and odometry have shown."""

    def __init__(self, references: References, params: LocalizerParams) -> None:
        self._references, self._map_error, self._params = references, references.error, params
        self._odometry = OdometryCheck(params.prior.odometry_error)
        self.mask = ViewMask(params.registration)
        self.lens = LensWatch(references.pixels_per_radian)
        self._is_refused = False  # the image before, which could be used
        self._count, self._is_biased = 0, False  # biased: when last checked
        self._innovations: deque[float] = deque(maxlen=NUM_INNOVATIONS)  # squared, of images from their predictions

    def reset(self) -> None:
        """Forget the stream: it is another, or an operator has said where the camera is; the map stays known."""
        self._odometry.reset()
        self.mask.reset()
        self.lens.reset()
        self._count, self._is_biased, self._is_refused = 0, False, False
        self._innovations.clear()

    def begin(self, frame: LocalizerInput, state: State) -> None:
        """Note odometry, whatever becomes of the image; `state` is what the image before has led to."""
        if self._is_refused:
            self._map_error.fade()
        self._is_refused = bool(frame.images)  # until it is placed
        self._odometry.propagate(frame.T_odom_camera, is_trusted=state is State.TRACKING)

    def find_due(self, state: State) -> Aspect:
        """Return the checks due for the residuals of the next image."""
        if state not in TRUSTED:
            return EVERYTHING | Aspect.PLACE
        if state is not State.TRACKING or self._is_biased:
            return EVERYTHING
        return CHECKS_DUE.get(self._count % INTEGRITY_PERIOD, NOTHING)

    def assess(
        self,
        chosen: RigChoice,
        alignment: Alignment | None,
        prediction: Prediction,
        state: State = State.SEARCHING,
        usual_ncc: float = 0.0,
    ) -> PoseCandidate:
        """Return an alignment as a candidate, accepted or refused; None: no reference covers the images.

        Checks of the residuals are those due in a state; all where the images resemble the map less than usual. A
        bias that they find is removed. Every jump is allowed from a guess.
        """
        choice = chosen.choice
        if alignment is None:
            limit, detail = GOOD_OVERLAP, "no key sphere covers the view"
            refusal = refuse(Verdict(Reason.LOW_OVERLAP, choice.overlap, limit, detail))
            return PoseCandidate(prediction.T_map_camera, UNKNOWN, prediction, choice, refusal)
        images, registration = chosen.covered, self._params.registration
        motion = prediction.frame_motion(self._params.camera.readout)
        has_failed = not alignment.is_converged
        if has_failed and prediction.asks_parts:
            alignment = align_by_parts(alignment, images, prediction, registration)
        is_by_parts = has_failed and alignment.is_converged
        is_unusual = has_failed or not usual_ncc or alignment.ncc < FULL_CHECK_NCC * usual_ncc
        # No grey levels pull a pose that they have not given.
        due = Aspect.FIT if is_by_parts else self.find_due(state) | (EVERYTHING if is_unusual else NOTHING)
        structure, is_biased, remaining = None, has_failed, np.zeros((6, 6))
        if alignment.is_converged and due:
            structure = self._look_at(images, alignment, prediction, motion, due)
            alignment, remaining, is_pulled = mend(alignment, structure)
            is_biased = has_failed or is_pulled
        pose = alignment.T_world_camera
        T_sphere_camera = choice.views[0].T_world_reference.inverse() @ pose
        covariance = alignment.covariance + remaining + self._map_error.covariance(choice.ids[0], T_sphere_camera)
        limits = self._params.acceptance, registration.max_mad
        acceptance = assess(alignment, covariance, choice, prediction, *limits, structure)
        evidence = prediction, choice, acceptance, alignment, motion, images
        found = structure or Structure()
        is_by_parts = is_by_parts or found.support.chance <= MAX_PREDICTED_CHANCE
        is_proven = is_by_parts or found.chance <= MAX_PREDICTED_CHANCE
        candidate = PoseCandidate(pose, covariance, *evidence, is_biased=is_biased)
        return replace(candidate, is_by_parts=is_by_parts, is_proven=is_proven)

    def _look_at(
        self,
        images: Sequence[RigImage],
        alignment: Alignment,
        prediction: Prediction,
        motion: FrameMotion | None,
        due: Aspect,
    ) -> Structure:
        """Return what the residuals say, of a pose of which something else is known."""
        predicted = prediction.T_map_camera if prediction.asks_parts else None
        structure = find_rig_structure(images, alignment, self._params.registration, motion, due, predicted)
        return hold_to(prediction.expected, structure, alignment)

    def start(self, frame: LocalizerInput, candidate: PoseCandidate) -> bool:
        """Begin at a candidate that a search has found; return whether odometry says that the camera has gone there."""
        self._is_refused = False
        self._innovations.clear()
        sample = _make_sample(frame, candidate)
        return sample is not None and self._odometry.start(sample)

    def confirm(self, frame: LocalizerInput, candidate: PoseCandidate, placed: PoseCandidate, state: State) -> Verdict:
        """Note a candidate accepted in a state; return what is against it: lens, itself, what preceded it, odometry.

        `placed`: the same, joined with its prediction.
        """
        alignment, registration = candidate.alignment, self._params.registration
        self._count, self._is_biased, self._is_refused = self._count + 1, candidate.is_biased, False
        if self._count % INTEGRITY_PERIOD == MAP_PHASE and alignment is not None and not candidate.is_biased:
            self._map_error.observe(candidate.images, alignment, registration, candidate.motion)
        self.mask.observe(candidate)
        sample, joined = (_make_sample(frame, one) for one in (candidate, placed))
        defies = candidate.prediction.defies_odometry
        by_odometry = self._odometry.find(sample, joined, defies_odometry=defies) if sample else FINE
        by_lens = self.lens.observe(candidate, registration, state)
        by_prediction = candidate.prediction.finding, self._compare(candidate)
        findings = by_lens, candidate.finding, *by_prediction, by_odometry
        return next((finding for finding in findings if finding.reason is not Reason.NONE), FINE)

    def _compare(self, candidate: PoseCandidate) -> Verdict:
        """Say whether the latest images together are farther from where they were expected than their covariances say.

        Each alone may be, but not all of them: what is aligned is not the map, or what was expected is wrong.
        """
        self._innovations.append(candidate.prediction.distance(candidate.T_map_camera, candidate.covariance) ** 2)
        squared, limit = sum(self._innovations), gate(6 * len(self._innovations), INNOVATION_RATE)
        if squared <= limit:
            return FINE
        detail = f"squared deviation of {len(self._innovations)} images from their predictions"
        return Verdict(Reason.JUMP_REJECTED, squared, limit, detail)


Locate = Callable[[Prediction, Tried], PoseCandidate]  # by another experience than those
Verify = Callable[[PoseCandidate], PoseCandidate]  # by the last images, where the map refuses it; by odometry


def find_candidate(prediction: Prediction, locate: Locate, verify: Verify, references: References) -> PoseCandidate:
    """Return the candidate of a prediction; where it is not sure, a better one by local contrast or other experiences.

    What explained an image, an experience by grey levels or by their local contrast, serves until it does no more.
    """
    candidate = verify(_ask_otherwise(locate(prediction, ()), locate, references))
    if candidate.acceptance.is_good:
        references.adopt(candidate.choice)
    return candidate


def _ask_otherwise(candidate: PoseCandidate, locate: Locate, references: References) -> PoseCandidate:
    """Return a candidate, or a better one: the same experience in the other mode, then others, by local contrast."""
    if is_sure(candidate, references):
        return candidate
    by_contrast, prediction = candidate.choice.by_contrast, candidate.prediction
    tried = tuple(references.node(one).experience for one in candidate.choice.ids[:1])
    if references.knows_contrast and (tried or by_contrast):
        other = locate(replace(prediction, by_contrast=not by_contrast, asks_parts=False), ())
        candidate = other if explains_more(other, candidate) else candidate
    otherwise = replace(prediction, by_contrast=True) if references.knows_contrast else prediction
    while 0 < len(tried) <= NUM_OTHER_EXPERIENCES and not is_sure(candidate, references):
        other = locate(otherwise, tried)
        tried = (*tried, references.node(other.choice.ids[0]).experience) if other.choice.ids else ()
        candidate = other if is_better(other, candidate, references) else candidate
    return candidate


def is_sure(candidate: PoseCandidate, references: References) -> bool:
    """Whether a candidate is good and nothing else need be asked.

    Grey levels that resemble the map little, or only in parts, are compared with local contrast.
    """
    is_alike = candidate.choice.by_contrast or (candidate.ncc >= SURE_GRAY_NCC and not candidate.is_by_parts)
    return candidate.acceptance.is_good and (is_alike or not references.knows_contrast)


def explains_more(other: PoseCandidate, candidate: PoseCandidate) -> bool:
    """Whether a candidate by local contrast serves where one by grey levels is not good, or the other way round.

    Grey levels that resemble the map little are surer than they may be: local contrast that is accepted goes before
    them.
    """
    if not (candidate.is_accepted and other.is_accepted):
        return other.is_accepted
    gray = candidate if other.choice.by_contrast else other
    is_doubtful = gray.ncc < SURE_GRAY_NCC and not (gray.is_by_parts or gray.is_by_range)
    return other.choice.by_contrast if is_doubtful else other.acceptance.is_good


def is_better(one: PoseCandidate, other: PoseCandidate, references: References) -> bool:
    """Whether a candidate is accepted, and more surely than another one."""
    one_is_sure, other_is_sure = (is_sure(some, references) for some in (one, other))
    return one.is_accepted and (one_is_sure, one.acceptance.quality) > (other_is_sure, other.acceptance.quality)


def align_rig(chosen: RigChoice, prediction: Prediction, params: LocalizerParams) -> Alignment | None:
    """Return the alignment of the images that references cover, all at once; None where they cover none."""
    images, registration = chosen.covered, params.registration
    if not images:
        return None
    if not (prediction.is_guess or prediction.defies_odometry):
        first = find_first_level(prediction, chosen.choice, images[0].pyramid)
        registration = between(registration, coarsest=min(first, registration.pyramid.coarsest))
    motion = prediction.frame_motion(params.camera.readout)
    found = register_rig(images, prediction.T_map_camera, registration, motion, prediction.expected)
    return replace(found, covariance=CONTRAST_COVARIANCE * found.covariance) if chosen.choice.by_contrast else found


def find_first_level(prediction: Prediction, choice: Choice, pyramid: Pyramid) -> int:
    """Return the coarsest level needed: the one at which the uncertainty of the prediction is about a pixel."""
    deviation = np.sqrt(np.diagonal(prediction.covariance))
    angle = np.max(deviation[3:]) + np.max(deviation[:3]) / choice.typical_range_m
    pixels = angle * pyramid.levels[0].camera.pixels_per_radian
    return max(0, int(np.ceil(np.log2(max(pixels, 1.0)))))


def align_by_parts(
    alignment: Alignment, images: Sequence[RigImage], prediction: Prediction, params: RegistrationParams
) -> Alignment:
    """Return an alignment that failed at the pose on which parts of the view agree, where these prove it."""
    found = register_parts(images, prediction.T_map_camera, params)
    if found.chance > MAX_PREDICTED_CHANCE:
        return alignment
    pose, covariance = prediction.expected.fuse(found.T_world_body, CORRELATED_CELLS * found.covariance)
    return replace(alignment, T_world_camera=pose, covariance=covariance, reason=GOOD)


def hold_to(expected: Expectation, structure: Structure, alignment: Alignment) -> Structure:
    """Return what was found of residuals, which know images alone, as it is of a pose of which something is known."""
    pose, support = alignment.T_world_camera, structure.support
    if support.is_proven:
        there, covariance = expected.fuse(pose @ SE3.exp(support.xi), support.covariance)
        support = replace(support, xi=(pose.inverse() @ there).log(), covariance=covariance)
    occlusion = replace(structure.occlusion, xi=expected.resist(structure.occlusion.xi, pose, alignment.covariance))
    return replace(structure, occlusion=occlusion, support=support)


def mend(alignment: Alignment, structure: Structure) -> tuple[Alignment, NDArray[np.float64], bool]:
    """Return the alignment without what pulls it, the covariance (6, 6) of what may remain, and whether anything does.

    What has changed may pull the next image, too.
    """
    if structure.support.is_proven:
        alignment = take_support(alignment, structure.support)
    is_occluded = structure.occlusion.share >= OCCLUSION_SHARE
    mended, remaining = remove_bias(alignment, structure.occlusion) if is_occluded else (alignment, np.zeros((6, 6)))
    return mended, remaining, is_occluded or structure.support.num_cells > 0


def take_support(alignment: Alignment, support: Support) -> Alignment:
    """Return the alignment at the pose of the parts that agree, as certain as these are."""
    pose = alignment.T_world_camera @ SE3.exp(support.xi)
    return replace(alignment, T_world_camera=pose, covariance=support.covariance)


def remove_bias(alignment: Alignment, bias: PoseBias) -> tuple[Alignment, NDArray[np.float64]]:
    """Return the alignment less a bias, and the covariance (6, 6) of what may remain of it."""
    remaining = np.diag(np.repeat(REMAINING_BIAS * np.array(bias.lengths), 3) ** 2)
    return replace(alignment, T_world_camera=alignment.T_world_camera @ SE3.exp(bias.xi)), remaining


def _make_sample(frame: LocalizerInput, candidate: PoseCandidate) -> OdometrySample | None:
    if frame.T_odom_camera is None:
        return None
    return OdometrySample(frame.stamp_ns, candidate.T_map_camera, candidate.covariance, frame.T_odom_camera)
