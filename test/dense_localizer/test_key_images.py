"""Key images are placed, surely, away from one another; a drive of which few were explained is a lesson."""

from types import SimpleNamespace

import numpy as np

from dense_localizer.judge.estimate import CameraEstimate
from dense_localizer.key_images import KeyImages, is_explained, is_lesson
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import State, Status

KEY_REACH, KEY_TURN, MAX_KEY_SIGMA_M, MIN_EXPLAINED_NCC, MIN_KEY_IMAGES = 0.1, 0.1, 0.05, 0.8, 6

REGION_M = 2.0


def estimate(x=0.0, yaw=0.0, *, state=State.TRACKING, ncc=0.9, sigma_m=0.01, is_by_map=True, **values):
    choice = SimpleNamespace(region_m=values.get("region_m", REGION_M))
    is_accepted = values.get("is_accepted", True)
    candidate = SimpleNamespace(is_accepted=is_accepted, is_by_map=is_by_map, ncc=ncc, choice=choice)
    covariance = np.eye(6) * sigma_m**2
    return CameraEstimate(Status(state), SE3.from_planar(x, 0.0, yaw), covariance, candidate=candidate)


def test_key_images_are_apart_by_way_or_turn():
    chosen, step = KeyImages(), KEY_REACH * REGION_M
    assert chosen.choose(estimate())
    assert not chosen.choose(estimate(0.99 * step, 0.99 * KEY_TURN))
    assert chosen.choose(estimate(1.01 * step))
    assert chosen.choose(estimate(0.0, 1.01 * KEY_TURN))
    assert not chosen.choose(estimate())  # also where the first one was, after others


def test_a_place_that_was_explained_may_be_seen_in_another_light():
    chosen = KeyImages()
    assert chosen.choose(estimate())
    assert chosen.choose(estimate(ncc=0.5))
    assert not chosen.choose(estimate(ncc=0.5))


def test_an_image_that_was_not_placed_surely_is_none():
    for values in [{"is_accepted": False}, {"sigma_m": 1.01 * MAX_KEY_SIGMA_M}, {"region_m": np.inf}]:
        assert not KeyImages().choose(estimate(**values))


def test_explained_is_tracked_by_the_map_and_alike():
    assert is_explained(estimate(ncc=MIN_EXPLAINED_NCC))
    assert not is_explained(estimate(ncc=MIN_EXPLAINED_NCC - 0.001))
    assert not is_explained(estimate(state=State.DEGRADED))
    assert not is_explained(estimate(is_by_map=False))


def test_a_lesson_was_explained_badly():
    for number, explained, expected in [(10, 8, False), (10, 7, True), (MIN_KEY_IMAGES - 1, 0, False)]:
        assert is_lesson([k < explained for k in range(number)]) == expected
