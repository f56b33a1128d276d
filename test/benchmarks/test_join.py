"""The best curve onto a path: on a straight it is full lock from the first moment on."""

import math

import numpy as np
import pytest

from benchmarks.drive.join import GROWTH, draw, drive_onto, least_offset, straight_and_bends
from path_follower.routes.building import even_curve

BEND = 0.4  # 1/m


@pytest.fixture
def straight():
    x = np.arange(0.0, 30.0, 0.1)
    return even_curve(x, 0.0 * x, 0.0 * x, 0.0 * x + 1.0)


@pytest.mark.parametrize(("left", "turned"), [(0.5, 20.0), (-0.3, -9.0), (0.5, -20.0), (0.02, -20.0), (-0.05, 15.0)])
def test_on_a_straight_nothing_is_better_than_full_lock_at_once(straight, left, turned):
    rad = math.radians(turned)
    beyond = (1.0 - math.cos(rad)) / BEND
    expected = abs(left) + beyond if left * turned > 0 else max(abs(left), beyond - abs(left))
    assert least_offset(straight, 5.0, left, rad, BEND) == pytest.approx(expected, abs=0.002)  # steps of 2 cm


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_bend_towards_the_start_costs_more_and_one_away_from_it_less(side):
    angle = np.arange(0.0, 4.0, 0.01)
    ring = even_curve(8.0 * np.sin(angle), side * (8.0 - 8.0 * np.cos(angle)), side * angle, 0.0 * angle + 1.0)
    same, other = (least_offset(ring, 5.0, side * sign * 0.5, side * sign * 0.3, BEND) for sign in (-1.0, 1.0))
    plain = 0.5 + (1.0 - math.cos(0.3)) / BEND
    assert other < plain - 0.01 < plain + 0.01 < same
    assert same == pytest.approx(0.5 + (1.0 - math.cos(0.3)) / (BEND - 1 / 8), rel=0.02)


@pytest.mark.slow
def test_no_drive_does_better_than_the_best_curve_and_none_much_worse():
    network = straight_and_bends()
    for number in (16, 31):
        rng = np.random.default_rng([101, number])
        join = drive_onto(network, *draw(rng, network), rng)
        assert 1.1 < join.least / abs(join.left) < GROWTH
        assert join.least < join.worst < join.least + 0.03
