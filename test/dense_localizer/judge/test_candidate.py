"""What is asked of a candidate before anything goes on from it, and what refuses it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from dense_localizer.judge.candidate import PoseCandidate, assess, assess_range, refuse
from dense_localizer.motion_prior import Prediction
from dense_localizer.params import AcceptanceParams
from dense_localizer.reasons import REMEDIES
from dense_localizer.references.reference import Choice
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import FINE, Reason
from sphere_nav.photometric import Alignment
from sphere_nav.photometric.checks.structure import PoseBias, Structure, Support

HERE, NOTHING_CHOSEN = SE3.identity(), Choice((), (), 0.0, np.inf, np.inf, np.inf)


def test_half_a_meter_is_certain_enough_to_go_on():
    for sigma_m, is_certain in [(0.49, True), (0.51, False)]:
        covariance = np.diag([1e-6, sigma_m**2, 1e-6, 1e-6, 1e-6, 1e-6])
        found = PoseCandidate(HERE, covariance, Prediction.guess(HERE), NOTHING_CHOSEN, refuse(FINE))
        assert found.is_certain == is_certain


PARAMS = AcceptanceParams()
TIGHT = np.diag([1e-6] * 3 + [1e-7] * 3)
GOOD = Alignment(
    T_world_camera=SE3.identity(),
    covariance=TIGHT,
    reason="",
    iterations=9,
    num_pixels=20_000,
    overlap=0.9,
    inlier_share=0.8,
    mad=3.0,
    ncc=0.95,
    gains=(1.0, 1.1),
    biases=(0.0, -3.0),
)
PREDICTED = Prediction(SE3.identity(), TIGHT, 0)
GUESS = Prediction.guess(SE3.identity())


def assessed(alignment, covariance=TIGHT, distance_ratio=0.1, prediction=PREDICTED, structure=None, by_contrast=False):
    choice = Choice((0,), (), 1.0, 3.0 * distance_ratio, 5.0, 3.0, by_contrast)
    return assess(alignment, covariance, choice, prediction, PARAMS, structure=structure)


@pytest.mark.parametrize(
    ("overlap", "agreement", "is_accepted", "is_good", "told"),
    [
        (0.9, 0.9, True, True, ("", 0.0, 0.0)),
        (0.9, 0.78, True, False, (Reason.OUTLIERS, 0.78, 0.8)),
        (0.9, 0.3, False, False, (Reason.OUTLIERS, 0.3, 0.75)),
        (0.25, 0.9, False, False, (Reason.LOW_OVERLAP, 0.25, 0.3)),
    ],
)
def test_a_pose_by_ranges_must_overlap_and_agree(overlap, agreement, is_accepted, is_good, told):
    fit = SimpleNamespace(overlap=overlap, agreement=agreement)
    found = assess_range(fit, HERE, TIGHT, PREDICTED, PARAMS)
    assert (found.is_accepted, found.is_good) == (is_accepted, is_good)
    assert (found.finding.reason, found.finding.value, found.finding.limit) == told


def test_a_good_alignment_is_accepted_without_a_word_whatever_the_light():
    verdict = assessed(GOOD)
    assert (verdict.is_accepted, verdict.is_good, verdict.finding.reason) == (True, True, "")
    assert 0.5 < verdict.quality <= 1.0
    for change in [{"gains": (4.0, 5.0)}, {"biases": (-120.0, 90.0)}]:
        assert assessed(replace(GOOD, **change)).is_good


@pytest.mark.parametrize("prediction", [PREDICTED, GUESS])
def test_local_contrast_of_a_followed_camera_is_good_as_soon_as_it_is_used(prediction):
    """A start may be anywhere: it is held to those of grey levels."""
    for by_contrast in [False, True]:
        how = {"by_contrast": by_contrast, "prediction": prediction}
        is_free = by_contrast and prediction is PREDICTED
        for value, expected in ((0.19, (False, False)), (0.21, (True, is_free)), (0.26, (True, True))):
            verdict = assessed(GOOD, structure=Structure(agreement=value), **how)
            assert (verdict.is_accepted, verdict.is_good) == expected
        for value, expected in ((0.39, (False, False)), (0.41, (True, is_free)), (0.51, (True, True))):
            verdict = assessed(replace(GOOD, ncc=value), **how)
            assert (verdict.is_accepted, verdict.is_good) == expected


def test_each_cause_refuses_with_its_reason_and_remedy():
    for change, reason in [
        ({"overlap": 0.1}, "LOW_OVERLAP"),
        ({"num_pixels": 100}, "LOW_TEXTURE"),
        ({"inlier_share": 0.3}, "OUTLIERS"),
        ({"ncc": np.nan}, "OUTLIERS"),
        ({"ncc": 0.3, "gains": (0.2, 1.0)}, "LIGHT_CHANGE"),
        ({"inlier_share": 0.3, "biases": (-90.0, 0.0)}, "LIGHT_CHANGE"),
        ({"T_world_camera": SE3(np.full((4, 4), np.nan))}, "NO_CONVERGENCE"),
        ({"T_world_camera": SE3.exp([0.1, 0, 0, 0, 0, 0])}, "JUMP_REJECTED"),
        ({"reason": "NO_CONVERGENCE"}, "NO_CONVERGENCE"),
    ]:
        verdict = assessed(replace(GOOD, **change))
        assert (verdict.is_accepted, verdict.is_good, verdict.quality) == (False, False, 0.0)
        assert verdict.finding.reason == reason
        assert verdict.finding.reason in REMEDIES


def test_an_uncertain_pose_is_refused():
    for wide in (np.diag([0.05, 1e-6, 1e-6, 1e-7, 1e-7, 1e-7]), np.diag([1e-6] * 3 + [1e-7, 0.01, 1e-7])):
        verdict = assessed(GOOD, covariance=wide)
        assert (verdict.is_accepted, verdict.finding.reason) == (False, "LOW_TEXTURE")
    assert not assessed(GOOD, covariance=np.full((6, 6), np.inf)).is_accepted


def test_three_standard_deviations_of_a_good_pose_are_within_the_promise_along_and_about_each_axis():
    for sigma_m, is_good in ((0.099, True), (0.101, False), (0.199, False)):
        verdict = assessed(GOOD, covariance=np.diag([sigma_m**2, 1e-6, 1e-6, 1e-7, 1e-7, 1e-7]))
        assert (verdict.is_accepted, verdict.is_good) == (True, is_good)
    for sigma_rad, is_accepted, is_good in [(0.024, 1, 1), (0.026, 1, 0), (0.049, 1, 0), (0.051, 0, 0)]:
        found = assessed(GOOD, covariance=np.diag([1e-6] * 3 + [1e-7, sigma_rad**2, 1e-7]))
        assert (found.is_accepted, found.is_good) == (bool(is_accepted), bool(is_good))


def test_a_pose_beside_an_unsure_prediction_is_no_jump():
    assert PREDICTED.distance(SE3.exp([0.01, 0, 0, 0, 0, 0]), TIGHT) == pytest.approx(0.01 / np.sqrt(2e-6))


@pytest.mark.parametrize(("chance", "is_good"), [(1e-6, True), (1e-4, False)])
def test_parts_of_the_view_that_agree_more_than_by_chance_stand_for_all_of_it(chance, is_good):
    structure = Structure(agreement=0.05, support=Support(40, 15, chance))
    verdict = assessed(GOOD, structure=structure)
    assert (verdict.is_accepted, verdict.is_good) == (is_good, is_good)


@pytest.mark.parametrize("change", [{"ncc": -0.1}, {"ncc": 0.45}])
def test_where_parts_have_proven_a_pose_the_whole_only_says_how_much_has_changed(change):
    for chance, is_good in ((1e-6, True), (1e-4, False)):
        structure = Structure(agreement=0.3, support=Support(40, 15, chance))
        assert assessed(replace(GOOD, **change), structure=structure).is_good == is_good
    hidden = Structure(agreement=0.05, support=Support(40, 15, 1e-6))
    assert not assessed(replace(GOOD, overlap=0.1), structure=hidden).is_accepted  # what is not seen proves nothing


def test_a_pose_by_little_of_the_view_or_by_gradients_that_do_not_agree_is_not_driven_by():
    for change, is_accepted, is_good in [
        ({"overlap": 0.24}, True, False),
        ({"overlap": 0.26}, True, True),
        ({"inlier_share": 0.39}, False, False),
        ({"inlier_share": 0.49}, True, False),
        ({"inlier_share": 0.51}, True, True),
    ]:
        found = assessed(replace(GOOD, **change))
        assert (found.is_accepted, found.is_good) == (is_accepted, is_good)
    for structure, is_accepted, is_good in [
        (Structure(0.19), False, False),
        (Structure(0.24), True, False),
        (Structure(0.26), True, True),
    ]:
        found = assessed(GOOD, structure=structure)
        assert (found.is_accepted, found.is_good) == (is_accepted, is_good)


@pytest.mark.parametrize(
    ("factor", "is_accepted", "is_good"),
    [(0.49, True, True), (0.51, True, False), (4.9, True, False), (5.1, False, False)],
)
def test_a_pose_that_a_cover_pulls_is_not_driven_by(factor, is_accepted, is_good):
    """By the largest uncertainty: 0.2 m, 0.05 rad; the bias was removed."""
    for axis in [0, 3]:
        xi = np.zeros(6)
        xi[axis] = factor * (0.2, 0.05)[axis // 3]
        found = assessed(GOOD, structure=Structure(occlusion=PoseBias(0.5, xi)))
        assert (found.is_accepted, found.is_good) == (is_accepted, is_good)


def test_a_pose_far_from_its_prediction_is_refused():
    for sigmas, is_good in [(5.5, True), (5.7, False)]:
        jumped = replace(GOOD, T_world_camera=SE3.exp([sigmas * np.sqrt(2e-6), 0, 0, 0, 0, 0]))
        found = assessed(jumped)
        assert (found.is_accepted, found.is_good) == (is_good, is_good)
        assert found.finding.reason == ("" if is_good else "JUMP_REJECTED")
    assert (found.finding.value, found.finding.limit) == (pytest.approx(5.7, rel=1e-3), 5.6)


def test_a_refusal_says_what_to_look_at():
    for change, distance_ratio, reason in [
        ({"gains": (1.9, 1.0), "biases": (49.0, -49.0)}, 0.9, "OUTLIERS"),
        ({"gains": (2.1, 1.0)}, 0.9, "LIGHT_CHANGE"),
        ({"gains": (1.0, 0.47)}, 0.9, "LIGHT_CHANGE"),
        ({"biases": (0.0, -51.0)}, 0.9, "LIGHT_CHANGE"),
        ({}, 1.1, "OUTSIDE_REGION"),
    ]:
        assert assessed(replace(GOOD, ncc=0.3, **change), distance_ratio=distance_ratio).finding.reason == reason


def test_every_reason_has_its_remedy():
    assert set(REMEDIES) == set(Reason)
    assert all(text for reason, text in REMEDIES.items() if reason)
