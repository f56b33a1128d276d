"""Where an image is not explained well, the key spheres of another day are asked; the better answer counts."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from dense_localizer.constants import ASK_ALL_S, MAX_HINT_CHANCE
from dense_localizer.motion_prior import Prediction
from dense_localizer.track.candidates import find_candidate
from sphere_nav.geometry import SE3

NODES = {0: SimpleNamespace(experience="day"), 10: SimpleNamespace(experience="night")}


class Days:
    """References that note what they were asked."""

    adopted = None

    def node(self, number):
        return NODES[number]

    def adopt(self, choice):
        self.adopted = choice.ids


def candidate(quality, ids=(0,), prediction="here", chance=None):
    """Accepted from 0, good from 0.5."""
    acceptance = SimpleNamespace(quality=max(quality, 0.0), is_good=quality >= 0.5)
    choice = SimpleNamespace(ids=ids)
    judged = SimpleNamespace(is_accepted=quality >= 0.0, acceptance=acceptance)
    return SimpleNamespace(**vars(judged), choice=choice, prediction=prediction, chance=chance)


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
