"""Ground and area of small maps whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from mcl_depth.geometry.area import Area, find_area, limits_of
from mcl_depth.geometry.ground import Ground
from mcl_depth.params import AreaParams

PARAMS = AreaParams()
UP = np.array([0.0, 0.0, 1.0])


def floor(x0, x1, y0=0.0, y1=4.0, slope=0.0):
    x, y = np.meshgrid(np.arange(x0, x1, 0.1), np.arange(y0, y1, 0.1))
    return np.column_stack([x.ravel(), y.ravel(), slope * x.ravel()])


def area_of(points, params=PARAMS, box=None):
    ground = Ground(points)
    return find_area(points, lambda xy: ground.heights(xy) + 1.2, params, box)


def test_the_ground_follows_a_slope_and_ends_with_the_map():
    heights = Ground(floor(0.0, 10.0, slope=0.2)).heights(np.array([[3.0, 2.0], [7.0, 2.0], [30.0, 2.0]]))
    assert heights[1] - heights[0] == pytest.approx(0.8, abs=0.01)  # the lowest point of each square, alike in all
    assert abs(heights[0] - 0.6) < 0.1  # a square of 0.5 m falls by 0.1 m
    assert np.isnan(heights[2])


def test_a_roof_is_not_the_ground_and_small_holes_are_closed():
    points = floor(0.0, 6.0)
    points = points[np.hypot(points[:, 0] - 3.0, points[:, 1] - 2.0) > 0.8]
    heights = Ground(np.concatenate([points, points + UP * 5.0])).heights(np.array([[3.0, 2.0], [1.0, 1.0]]))
    np.testing.assert_allclose(heights, 0.0, atol=1e-9)


def test_a_wall_keeps_its_distance_and_cuts_off_the_smaller_part():
    y, z = np.meshgrid(np.arange(0.0, 4.0, 0.1), np.arange(0.0, 2.5, 0.1))
    wall = np.column_stack([np.full(y.size, 6.0), y.ravel(), z.ravel()])
    area = area_of(np.concatenate([floor(0.0, 8.0), wall]))
    assert area.middles[:, 0].max() <= 6.0 - PARAMS.clearance
    assert area.contains(np.array([[2.0, 2.0], [7.5, 2.0]])).tolist() == [True, False]


def test_box_and_limits_both_bound_the_area():
    area = area_of(floor(0.0, 8.0), AreaParams(step=0.5, limits="1,1,7,3"), box=(2.0, 0.0, 9.0, 9.0))
    low, high = area.middles.min(axis=0), area.middles.max(axis=0)
    np.testing.assert_allclose([*low, *high], [2.25, 1.25, 6.75, 2.75])


def test_limits_that_say_nothing_are_refused():
    assert limits_of("") is None
    for text in ("1,2,3", "1,2,a,4", "3,0,1,9"):
        with pytest.raises(ValueError, match=r"area\.limits: expected x0,y0,x1,y1"):
            limits_of(text)


def test_without_a_free_place_there_is_no_area():
    with pytest.raises(ValueError, match="expected a place with ground and free space"):
        area_of(np.concatenate([floor(0.0, 3.0), floor(0.0, 3.0) + UP * 1.2]))


def test_draws_are_spread_evenly_over_the_squares():
    area = Area(np.array([[float(k), 0.0] for k in range(10)]), 0.5)
    drawn = area.draw(1000, np.random.default_rng(2))
    counts = np.bincount(np.round(drawn[:, 0]).astype(int), minlength=10)
    assert np.all(np.abs(counts - 100) <= 1)
    assert np.abs(drawn[:, 1]).max() <= 0.25
