"""Which pose an image is placed at: that of the likeliest prediction, or by key spheres of another day."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

from dense_localizer.constants import ASK_ALL_S, MAX_HINT_CHANCE, MAX_SAME_POSE, SURE_GRAY_NCC
from dense_localizer.judge.candidate import PoseCandidate, select_first_accepted
from dense_localizer.motion_prior import Prediction
from dense_localizer.references.reference import References
from sphere_nav.estimation.gates import squared_mahalanobis
from sphere_nav.localization.status import Reason
from sphere_nav.spheres.graph import Experience

Locate = Callable[[Prediction, Experience | None], PoseCandidate]  # by another experience than that one


def find_candidate(predictions: Iterable[Prediction], locate: Locate, references: References) -> PoseCandidate:
    """Return the first accepted candidate; where it is not good, a better one by local contrast or another experience.

    What explained an image, grey levels or their local contrast, serves until it does no more.
    """
    candidate = select_first_accepted(_locate_each(predictions, locate))
    by_contrast = candidate.choice.by_contrast
    if not (candidate.choice.ids or by_contrast):
        return candidate
    is_sure = by_contrast or candidate.ncc >= SURE_GRAY_NCC
    if candidate.acceptance.is_good and is_sure and not candidate.is_by_parts:
        return candidate
    if references.knows_contrast:
        other = locate(replace(candidate.prediction, by_contrast=not by_contrast, asks_parts=False), None)
        if explains_more(other, candidate):
            references.adopt(other.choice)
            return other
    if candidate.acceptance.is_good or not candidate.choice.ids:
        return candidate
    tried = references.node(candidate.choice.ids[0]).experience
    other = locate(candidate.prediction, tried)
    if not is_better(other, candidate):
        return candidate
    references.adopt(other.choice)
    return other


def explains_more(other: PoseCandidate, candidate: PoseCandidate) -> bool:
    """Whether a candidate by local contrast serves where one by grey levels is not good, or the other way round.

    Not where both have the pose jump to one place: they confirm the jump, and the care that it asks for.
    """
    if not candidate.is_accepted:
        return other.is_accepted
    if not other.acceptance.is_good:
        return False
    xi = (candidate.T_map_camera.inverse() @ other.T_map_camera).log()
    is_there = squared_mahalanobis(xi, candidate.covariance + other.covariance) <= MAX_SAME_POSE**2
    return not (is_there and candidate.finding.reason is Reason.JUMP_REJECTED)


def is_better(one: PoseCandidate, other: PoseCandidate) -> bool:
    """Whether a candidate is accepted, and more surely than another one."""
    return one.is_accepted and one.acceptance.quality > other.acceptance.quality


def _locate_each(predictions: Iterable[Prediction], locate: Locate) -> Iterator[PoseCandidate]:
    """Yield the candidate of each prediction; parts of the view, which take longest, are asked while they may help.

    Where from one prediction no more of them agree than by chance, they rarely do from another one: that is tried for
    some images, then only the likeliest.
    """
    least: float | None = None
    for prediction in predictions:
        may_help = least is None or least <= MAX_HINT_CHANCE or prediction.age_s <= ASK_ALL_S
        candidate = locate(prediction if may_help else replace(prediction, asks_parts=False), None)
        if candidate.chance is not None:
            least = candidate.chance if least is None else min(least, candidate.chance)
        yield candidate
