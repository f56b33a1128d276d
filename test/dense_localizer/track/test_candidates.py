"""Where an image is not explained well, local contrast and the key spheres of another day are asked."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from dense_localizer.constants import ASK_ALL_S, MAX_HINT_CHANCE
from dense_localizer.motion_prior import Prediction
from dense_localizer.track.candidates import find_candidate
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import Reason

NODES = {0: SimpleNamespace(experience="day"), 10: SimpleNamespace(experience="night")}


class Days:
    """References that note what they were asked."""

    adopted = by_contrast = None
    knows_contrast = False

    def node(self, number):
        return NODES[number]

    def adopt(self, choice):
        self.adopted, self.by_contrast = choice.ids, choice.by_contrast


def candidate(quality, ids=(0,), prediction="here", chance=None, **more):
    """Accepted from 0, good from 0.5."""
    acceptance = SimpleNamespace(quality=max(quality, 0.0), is_good=quality >= 0.5)
    choice = SimpleNamespace(ids=ids, by_contrast=more.get("by_contrast", False))
    judged = SimpleNamespace(is_accepted=quality >= 0.0, acceptance=acceptance, covariance=1e-4 * np.eye(6))
    judged.T_map_camera = SE3.exp([more.get("x", 0.0), 0.0, 0.0, 0.0, 0.0, 0.0])
    judged.finding = SimpleNamespace(reason=more.get("reason", Reason.OUTLIERS))
    evidence = {"chance": chance, "is_by_parts": more.get("is_by_parts", False), "ncc": more.get("ncc", 1.0)}
    return SimpleNamespace(**vars(judged), choice=choice, prediction=prediction, **evidence)


HERE = Prediction.guess(SE3.identity(), is_near=True)


@pytest.mark.parametrize("serves", [False, True])
@pytest.mark.parametrize(
    ("first", "other", "is_by_parts", "is_taken"),
    [
        (0.6, None, False, False),  # a good one costs nothing
        (0.6, 0.5, True, True),  # parts of the view are more work than the whole of it
        (0.6, 0.4, True, False),
        (0.3, 0.5, False, True),
        (0.3, 0.4, False, False),  # neither is good: what served before goes on
        (-1.0, 0.1, False, True),
        (-1.0, -1.0, False, False),
    ],
)
def test_local_contrast_serves_where_grey_levels_are_not_good_and_these_where_it_is_not(
    serves, first, other, is_by_parts, is_taken
):
    days, asked = Days(), []
    days.knows_contrast = True
    one = candidate(first, prediction=HERE, is_by_parts=is_by_parts, by_contrast=serves)
    another = candidate(-1.0 if other is None else other, by_contrast=not serves)

    def locate(prediction, tried):
        asked.append((prediction.by_contrast, prediction.asks_parts, tried))
        return {None: one, not serves: another}[prediction.by_contrast] if tried is None else candidate(-1.0, (10,))

    assert find_candidate([HERE], locate, days) is (another if is_taken else one)
    assert asked[:2] == [(None, True, None)] + [(not serves, False, None)] * (other is not None)
    assert days.by_contrast is (not serves if is_taken else None)


@pytest.mark.parametrize(("ncc", "serves", "is_asked"), [(0.89, False, True), (0.91, False, False), (0.6, True, False)])
def test_what_resembles_the_map_little_is_looked_at_by_contrast(ncc, serves, is_asked):
    """Grey levels that correlate so have been 0.3 m off in TRACKING, among other cars."""
    days = Days()
    days.knows_contrast = True
    one, another = candidate(0.9, prediction=HERE, by_contrast=serves, ncc=ncc), candidate(0.6, by_contrast=not serves)
    found = find_candidate([HERE], lambda how, _: one if how.by_contrast is None else another, days)
    assert found is (another if is_asked else one)


@pytest.mark.parametrize(
    ("x", "reason", "is_taken"),
    [(0.03, Reason.JUMP_REJECTED, False), (0.1, Reason.JUMP_REJECTED, True), (0.03, Reason.OUTLIERS, True)],
)
def test_both_confirm_a_jump_or_do_not(x, reason, is_taken):
    """0.014 m is the standard deviation of both together."""
    days = Days()
    days.knows_contrast = True
    one, another = candidate(0.3, (), HERE, by_contrast=True, reason=reason), candidate(0.7, x=x)
    found = find_candidate([HERE], lambda how, _: one if how.by_contrast is None else another, days)
    assert found is (another if is_taken else one)


def test_without_a_key_sphere_of_that_contrast_grey_levels_are_asked():
    days = Days()
    days.knows_contrast = True
    one, another = candidate(-1.0, (), HERE, by_contrast=True), candidate(0.7)
    assert find_candidate([HERE], lambda how, _: one if how.by_contrast is None else another, days) is another


@pytest.mark.parametrize(
    ("first", "other", "is_taken"),
    [
        (0.6, 0.9, False),
        (0.3, 0.4, True),
        (0.4, 0.3, False),
        (-1.0, 0.1, True),
        (-1.0, -1.0, False),
        (0.3, -1.0, False),
    ],
)
def test_the_better_of_two_experiences_counts_where_the_first_is_not_good(first, other, is_taken):
    one, another, days, asked = candidate(first), candidate(other, (10,)), Days(), []

    def locate(prediction, tried):
        asked.append((prediction, tried))
        return one if tried is None else another

    found = find_candidate(["here"], locate, days)
    assert found is (another if is_taken else one)
    assert asked == [("here", None)] + [("here", "day")] * (first < 0.5)  # a good one costs nothing
    assert days.adopted == ((10,) if is_taken else None)


def test_where_nothing_covers_the_view_no_other_experience_is_asked():
    nothing = candidate(-1.0, ())
    assert find_candidate(["here"], lambda *_: nothing, Days()) is nothing


@pytest.mark.parametrize(
    ("chances", "age_s", "asked"),
    [
        ((0.3, 0.3, 0.3), 1.1 * ASK_ALL_S, [True, False, False]),
        ((2.0 * MAX_HINT_CHANCE, 0.0, 0.0), 9.0, [True, False, False]),
        ((0.5 * MAX_HINT_CHANCE, 0.3, 0.3), 9.0, [True, True, True]),  # some of the view is of this place
        ((None, 0.3, 0.3), 9.0, [True, True, False]),  # nobody asked
        ((0.3, 0.3, 0.3), 0.9 * ASK_ALL_S, [True, True, True]),
    ],
)
def test_parts_of_the_view_are_asked_of_other_predictions_while_they_may_help(chances, age_s, asked):
    told, left = [], list(chances)

    def locate(prediction, tried):
        told.append(prediction.asks_parts)
        return candidate(-1.0, (), prediction, left.pop(0) if prediction.asks_parts else None)

    first = replace(Prediction.guess(SE3.identity(), is_near=True), age_s=age_s)
    find_candidate([first, replace(first, is_fallback=True), replace(first, is_fallback=True)], locate, Days())
    assert told == asked
