"""Which pose an image is placed at: that of the likeliest prediction, or by key spheres of another day."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from dense_localizer.judge.candidate import PoseCandidate, select_first_accepted
from dense_localizer.motion_prior import Prediction
from dense_localizer.references.reference import References
from sphere_nav.spheres.graph import Experience

Locate = Callable[[Prediction, Experience | None], PoseCandidate]  # by another experience than that one


def find_candidate(predictions: Iterable[Prediction], locate: Locate, references: References) -> PoseCandidate:
    """Return the first accepted candidate; where that is not good, a better one by another experience."""
    candidate = select_first_accepted(locate(prediction, None) for prediction in predictions)
    if candidate.acceptance.is_good or not candidate.choice.ids:
        return candidate
    tried = references.node(candidate.choice.ids[0]).experience
    other = locate(candidate.prediction, tried)
    if not other.is_accepted or other.acceptance.quality <= candidate.acceptance.quality:
        return candidate
    references.adopt(other.choice)
    return other
