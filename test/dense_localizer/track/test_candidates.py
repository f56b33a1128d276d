"""Local contrast and another day are asked where an image is not explained well; where an alignment begins."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from dense_localizer.constants import CONTRAST_COVARIANCE, NUM_OTHER_EXPERIENCES
from dense_localizer.motion_prior import Prediction
from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import Choice, References
from dense_localizer.track.candidates import align_rig, find_candidate, find_first_level
from sphere_nav.geometry import SE3
from sphere_nav.params import build
from sphere_nav.photometric import build_pyramid
from sphere_nav.photometric.align.esm import register_rig
from sphere_nav.photometric.align.problem import RigImage
from worlds.localizer import PINHOLE, SMALL_IMAGES, at

PARAMS = build(LocalizerParams, SMALL_IMAGES)
NAMES = {0: "day", 10: "night", 20: "snow", 30: "rain", 40: "fog"}
NODES = {number: SimpleNamespace(experience=name) for number, name in NAMES.items()}


class Days:
    adopted = by_contrast = None

    def __init__(self, *, knows_contrast=False):
        self.knows_contrast = knows_contrast

    def node(self, number):
        return NODES[number]

    def adopt(self, choice):
        self.adopted, self.by_contrast = choice.ids, choice.by_contrast


def candidate(quality, ids=(0,), prediction="here", chance=None, **more):
    """Accepted from 0, good from 0.5."""
    acceptance = SimpleNamespace(quality=max(quality, 0.0), is_good=quality >= 0.5)
    choice = SimpleNamespace(ids=ids, by_contrast=more.get("by_contrast", False))
    judged = SimpleNamespace(is_accepted=quality >= 0.0, acceptance=acceptance, covariance=1e-4 * np.eye(6))
    evidence = {
        "chance": chance,
        "is_by_range": more.get("is_by_range", False),
        "is_by_parts": more.get("is_by_parts", False),
        "ncc": more.get("ncc", 1.0),
    }
    return SimpleNamespace(**vars(judged), choice=choice, prediction=prediction, **evidence)


HERE = Prediction.guess(SE3.identity(), is_near=True)
NOTHING = candidate(-1.0, (), HERE)  # nothing covers the view


def keep(candidate):
    """Stand for last images that say nothing."""
    return candidate


def test_the_last_images_have_the_last_word():
    by_map, step = candidate(-1.0, prediction=HERE), candidate(0.1, prediction=HERE)
    assert find_candidate(HERE, lambda *_: by_map, lambda one: step if one is by_map else one, Days()) is step


@pytest.mark.parametrize("serves", [False, True])
@pytest.mark.parametrize(
    ("first", "other", "is_by_parts", "is_taken"),
    [(0.3, 0.5, False, True), (0.3, 0.4, False, False), (-1.0, 0.1, False, True)],
)
def test_local_contrast_serves_where_grey_levels_are_not_good_and_these_where_it_is_not(
    serves, first, other, is_by_parts, is_taken
):
    days, asked = Days(knows_contrast=True), []
    one = candidate(first, prediction=HERE, is_by_parts=is_by_parts, by_contrast=serves)
    another = candidate(-1.0 if other is None else other, by_contrast=not serves)

    def locate(prediction, tried):
        asked.append((prediction.by_contrast, prediction.asks_parts, tried))
        return {None: one, not serves: another}[prediction.by_contrast] if not tried else candidate(-1.0, ())

    found = find_candidate(HERE, locate, keep, days)
    assert found is (another if is_taken else one)
    assert asked[:2] == [(None, True, ())] + [(not serves, False, ())] * (other is not None)
    assert days.by_contrast is (found.choice.by_contrast if found.acceptance.is_good else None)


@pytest.mark.parametrize(
    ("serves", "other", "is_asked", "is_taken"),
    [(False, 0.5, True, True), (False, 0.4, True, False), (True, 0.9, False, False)],
)
def test_where_grey_levels_are_alike_in_parts_alone_contrast_may_be_in_the_whole_view(
    serves, other, is_asked, is_taken
):
    """Not the other way round: by contrast parts were 17 mm off, by grey levels 45 mm, on a wet road."""
    days, asked = Days(knows_contrast=True), []
    one = candidate(0.6, prediction=HERE, is_by_parts=True, by_contrast=serves)
    another = candidate(other, by_contrast=not serves)

    def locate(prediction, tried):
        asked.append(prediction.by_contrast)
        return candidate(-1.0, ()) if tried else one if prediction.by_contrast is None else another

    assert find_candidate(HERE, locate, keep, days) is (another if is_taken else one)
    assert len(asked) == 1 + is_asked * (1 + (not is_taken))


@pytest.mark.parametrize(("ncc", "serves", "is_asked"), [(0.89, False, True), (0.91, False, False), (0.6, True, False)])
def test_what_resembles_the_map_little_is_looked_at_by_contrast(ncc, serves, is_asked):
    """Grey levels that correlate so have been 0.3 m off in TRACKING, among other cars."""
    days = Days(knows_contrast=True)
    one, another = candidate(0.9, prediction=HERE, by_contrast=serves, ncc=ncc), candidate(0.6, by_contrast=not serves)
    found = find_candidate(HERE, lambda how, _: one if how.by_contrast is None else another, keep, days)
    assert found is (another if is_asked else one)


@pytest.mark.parametrize(
    ("ncc", "by", "is_contrast"),
    [(0.89, "", True), (0.91, "", False), (0.89, "is_by_parts", False), (0.89, "is_by_range", False)],
)
@pytest.mark.parametrize("serves", [False, True])
def test_contrast_that_is_accepted_goes_before_grey_levels_that_resemble_the_map_little(serves, ncc, by, is_contrast):
    """Not where parts or the range say more.

    With a lens of 30 degrees they were 0.3 to 0.6 m off, good by themselves; contrast was right, but not sure."""
    days = Days(knows_contrast=True)
    gray = candidate(0.9, prediction=HERE, ncc=ncc, **{by or "is_by_parts": bool(by)})
    contrast = candidate(0.3, prediction=HERE, by_contrast=True, ncc=0.7)
    asked = {None: contrast if serves else gray, not serves: gray if serves else contrast}
    found = find_candidate(HERE, lambda how, tried: NOTHING if tried else asked[how.by_contrast], keep, days)
    assert found is (contrast if is_contrast else gray)


@pytest.mark.parametrize(
    ("first", "other", "is_taken"), [(0.6, 0.9, False), (0.3, 0.4, True), (0.4, 0.3, False), (-1.0, 0.1, True)]
)
def test_the_better_of_two_experiences_counts_where_the_first_is_not_good(first, other, is_taken):
    one, another, days, asked = candidate(first, prediction=HERE), candidate(other, (10,)), Days(), []

    def locate(prediction, tried):
        asked.append(tried)
        return {0: one, 1: another}.get(len(tried), candidate(-1.0, ()))

    found = find_candidate(HERE, locate, keep, days)
    assert found is (another if is_taken else one)
    is_done = first >= 0.5 or other >= 0.5  # a good one costs nothing
    assert asked == [(), ("day",), ("day", "night")][: 1 if first >= 0.5 else 2 if is_done else 3]
    is_good = found.acceptance.is_good  # what explains an image with care is not gone on with
    assert days.adopted == (found.choice.ids if is_good else None)


@pytest.mark.parametrize(
    ("qualities", "expected", "num_asked"),
    [((-1.0, 0.2, 0.3, 0.1), (20,), 4), ((-1.0, -1.0, -1.0, -1.0, 0.9), (0,), 1 + NUM_OTHER_EXPERIENCES)],
)
def test_one_experience_after_another_is_asked_until_one_is_good(qualities, expected, num_asked):
    asked = []

    def locate(prediction, tried):
        asked.append(tried)
        return candidate(qualities[len(tried)], (10 * len(tried),), HERE) if len(tried) < len(qualities) else NOTHING

    assert find_candidate(HERE, locate, keep, Days()).choice.ids == expected
    assert len(asked) == num_asked


def test_others_are_asked_by_contrast_which_knows_no_light():
    days, asked = Days(knows_contrast=True), []

    def locate(prediction, tried):
        asked.append((prediction.by_contrast, tried))
        found = candidate(-1.0, (10 * len(tried),), HERE, by_contrast=bool(prediction.by_contrast))
        return candidate(0.6, (20,), by_contrast=True) if len(tried) == 2 else found

    assert find_candidate(HERE, locate, keep, days).choice.ids == (20,)
    assert asked == [(None, ()), (True, ()), (True, ("day",)), (True, ("day", "night"))]
    assert (days.adopted, days.by_contrast) == ((20,), True)


def test_the_first_level_is_that_at_which_the_uncertainty_is_a_pixel(room):
    """110 pixels per radian, the scene at 2 m; position and attitude add up."""
    for sigma_m, sigma_rad, level in [(0.0, 1.1 / 110, 1), (0.0, 3.9 / 110, 2), (2.2 / 110, 3.1 / 110, 3)]:
        prediction = Prediction(SE3.identity(), np.diag([sigma_m**2, 0, 0, 0, 0, sigma_rad**2]), 0)
        choice = Choice((0,), (), 1.0, 0.0, typical_range_m=2.0, region_m=2.0)
        assert find_first_level(prediction, choice, build_pyramid(room.photograph(PINHOLE, at(0.0)), PINHOLE)) == level


def test_by_local_contrast_an_alignment_is_less_sure(room, room_map):
    pose, references = at(0.1, 0.0, 0.3), References(room_map, PARAMS)
    image = RigImage(build_pyramid(room.photograph(PINHOLE, pose), PINHOLE, PARAMS.registration.pyramid))
    prediction = replace(Prediction.guess(pose), by_contrast=True)
    chosen = references.choose_rig([image], prediction)
    found = align_rig(chosen, prediction, PARAMS)
    alone = register_rig(chosen.covered, pose, PARAMS.registration)
    assert np.all(np.less(found.T_world_camera.distance(pose), (0.015, 0.008)))
    np.testing.assert_allclose(found.covariance, CONTRAST_COVARIANCE * alone.covariance)
    references.close()


def test_a_sure_prediction_saves_levels_and_a_fallback_or_a_guess_takes_all(room, room_map):
    pose = at(0.1, 0.0, 0.3)
    image = RigImage(build_pyramid(room.photograph(PINHOLE, pose), PINHOLE, PARAMS.registration.pyramid))
    sure = Prediction(pose @ SE3.exp([0.003, 0, 0, 0, 0.002, 0]), 1e-8 * np.eye(6), 0)
    references, iterations = References(room_map, PARAMS), []
    for prediction in (sure, replace(sure, defies_odometry=True), Prediction.guess(sure.T_map_camera)):
        found = align_rig(references.choose_rig([image], prediction), prediction, PARAMS)
        assert np.all(np.less(found.T_world_camera.distance(pose), (0.015, 0.008)))
        iterations.append(found.iterations)
    assert iterations[0] < iterations[1] == iterations[2]
    references.close()
