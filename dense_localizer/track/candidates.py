"""Which pose an image is placed at: by grey levels or local contrast, by key spheres of this day or another one.

Each is an alignment to the references chosen for a prediction (M15 eq. 19), from the coarsest level that this needs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dense_localizer.constants import CONTRAST_COVARIANCE, NUM_OTHER_EXPERIENCES, SURE_GRAY_NCC
from dense_localizer.judge.candidate import PoseCandidate
from dense_localizer.motion_prior import Prediction
from dense_localizer.params import LocalizerParams
from dense_localizer.references.likeness import Tried
from dense_localizer.references.reference import Choice, References, RigChoice
from sphere_nav.photometric import Alignment, Pyramid
from sphere_nav.photometric.align.esm import register_rig
from sphere_nav.photometric.params import between

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
