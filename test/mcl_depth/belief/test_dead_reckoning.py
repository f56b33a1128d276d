"""A place carried on by odometry: where to, how much surer it is no more, and which images tell nothing new."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mcl_depth.belief.dead_reckoning import DeadReckoning
from mcl_depth.belief.estimate import Hypothesis, Observation
from mcl_depth.params import MclInputParams, MotionParams
from sphere_nav.geometry import Spherical
from sphere_nav.localization.status import State

CONFIRMED = Hypothesis(np.array([5.0, 6.0, np.pi / 2]), np.diag([0.04, 0.09, 0.01]), 0.9)


def observe(x, y, yaw):
    camera = Spherical(16, 8)
    return Observation(np.zeros((8, 16), np.uint8), camera, 10**9, np.eye(3), np.array([x, y, yaw]))


def reckoning(**params):
    found = DeadReckoning(MclInputParams(min_way=0.2), MotionParams(**params))
    found.update(CONFIRMED, observe(1.0, 1.0, 0.0), is_confirmed=True)
    return found


def test_ways_and_turns_keep_their_sides():
    for side in [1.0, -1.0]:
        pose, _ = reckoning().propagate(observe(1.0 + 0.6, 1.0 + 0.8 * side, 0.3 * side))
        np.testing.assert_allclose(pose, [5.0 - 0.8 * side, 6.6, np.pi / 2 + 0.3 * side])  # its heading is the map's y


def test_wheels_that_drift_stay_within_what_is_told():
    """A heading that walks at random over a way of 9 m, and a scale that is wrong by 5 %."""
    rng, way, count = np.random.default_rng(0), 9.0, 4000
    steps = rng.normal(0.0, np.radians(2.0) * np.sqrt(way / 90), (count, 90))
    headings = np.cumsum(steps, axis=1)
    length = way / 90 * (1.0 + rng.normal(0.0, 0.05, (count, 1)))
    x, y = (length * np.cos(headings)).sum(axis=1), (length * np.sin(headings)).sum(axis=1)
    _, covariance = reckoning(way_share=0.05, drift_deg=2.0).propagate(observe(1.0 + way, 1.0, 0.0))
    grown = np.sqrt(np.diag(covariance - CONFIRMED.covariance))
    assert headings[:, -1].std() == pytest.approx(grown[2], rel=0.05)
    for found in (x.std(), y.std()):  # one deviation serves both axes: it may not be too small for either
        assert 0.3 * grown[0] < found < grown[0]


@pytest.mark.parametrize(("way", "turn_deg", "is_near"), [(0.19, 2.9, True), (0.21, 0.0, False), (0.0, 3.1, False)])
def test_an_image_is_new_after_a_way_or_a_turn_of_three_degrees(way, turn_deg, is_near):
    image = observe(1.0 - 0.6 * way, 1.0 + 0.8 * way, -np.radians(turn_deg))
    assert reckoning().is_near(image, is_sure=True) == is_near


def test_a_pose_that_was_too_vague_stays_so_until_its_place_is_tracked():
    found, exact = reckoning(), np.diag([0.02, 0.02, 1.0]) ** 2
    wide = np.array([[0.06, 0.06, 0.0], [0.06, 0.06, 0.0], [0.0, 0.0, 0.0]])  # 0.35 m across
    asked = [(exact, State.DEGRADED), (wide, State.DEGRADED), (exact, State.DEGRADED), (exact, State.TRACKING)]
    assert [found.is_vague(one, 0.33, state) for one, state in asked] == [False, True, True, False]


def test_a_standstill_by_odometry_alone_is_looked_at_at_first_and_once_a_second():
    found, second = reckoning(), 10**9
    first, soon, later = (replace(observe(1.0, 1.0, 0.0), stamp_ns=stamp) for stamp in (2, 2 + second // 2, 2 + second))
    assert not found.is_near(first, is_sure=False)
    found.update(CONFIRMED, first, is_confirmed=True)
    assert found.is_near(soon, is_sure=False)
    assert not found.is_near(later, is_sure=False)
    assert found.is_near(later, is_sure=True)
