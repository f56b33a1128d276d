"""Ground and area of small maps whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from mcl_depth.geometry.area import Ground, find_area
from mcl_depth.params import AreaParams

PARAMS = AreaParams()
UP = np.array([0.0, 0.0, 1.0])


def floor(x0, x1, y0=0.0, y1=4.0, slope=0.0):
    x, y = np.meshgrid(np.arange(x0, x1, 0.1), np.arange(0.0, 4.0, 0.1))
    return np.column_stack([x.ravel(), y.ravel(), slope * x.ravel()])


def area_of(points, params=PARAMS):
    ground = Ground(points)
    return find_area(points, lambda xy: ground.heights(xy) + 1.2, params)


def test_the_ground_follows_a_slope_under_roofs_and_ends_with_the_map():
    heights = Ground(floor(0.0, 10.0, slope=0.2)).heights(np.array([[3.0, 2.0], [7.0, 2.0], [30.0, 2.0]]))
    assert heights[1] - heights[0] == pytest.approx(0.8, abs=0.01)  # the lowest point of each square, alike in all
    assert abs(heights[0] - 0.6) < 0.1  # a square of 0.5 m falls by 0.1 m
    assert np.isnan(heights[2])
    points = floor(0.0, 6.0)
    points = points[np.hypot(points[:, 0] - 3.0, points[:, 1] - 2.0) > 0.8]
    heights = Ground(np.concatenate([points, points + UP * 5.0])).heights(np.array([[3.0, 2.0], [1.0, 1.0]]))
    np.testing.assert_allclose(heights, 0.0, atol=1e-9)


def wall(x):
    y, z = np.meshgrid(np.arange(0.0, 4.0, 0.1), np.arange(0.0, 2.5, 0.1))
    return np.column_stack([np.full(y.size, x), y.ravel(), z.ravel()])


def test_a_wall_keeps_its_distance_and_the_room_behind_it_is_kept_if_it_is_large_enough():
    points, places = np.concatenate([floor(0.0, 8.0), wall(6.0)]), np.array([[2.0, 2.0], [7.5, 2.0]])
    area = area_of(points)
    assert np.abs(area.middles[:, 0] - 6.0).min() >= 0.3 - 0.02  # cells of the wall
    assert area.contains(places).tolist() == [True, True]
    smaller = area_of(points, AreaParams(min_piece=8.0))  # the part behind the wall has 7 m2
    assert smaller.contains(places).tolist() == [True, False]
    limits = np.array([1.0, 0.5, 4.0, 3.2])
    middles = area_of(points, AreaParams(limits="1,0.5,4,3.2")).middles
    np.testing.assert_allclose(np.append(middles.min(axis=0), middles.max(axis=0)), limits, atol=0.5 * PARAMS.step)


def test_without_a_free_place_there_is_no_area():
    with pytest.raises(ValueError, match="expected a place with ground and free space"):
        area_of(np.concatenate([floor(0.0, 3.0), floor(0.0, 3.0) + UP * 1.2]))


def test_heights_are_bilinear_between_the_middles_of_squares():
    """One point in the middle of each square, at heights that are no plane."""
    x, y = np.meshgrid(np.arange(5) * 0.5, np.arange(4) * 0.5, indexing="ij")
    z = 0.3 * x - 0.2 * y + 0.1 * x * y
    ground = Ground(np.column_stack([x.ravel(), y.ravel(), z.ravel()]))
    places = np.random.default_rng(0).uniform((0.25, 0.25), (2.2, 1.7), (50, 2))
    u, v = places.T - 0.25  # a square begins at its point
    np.testing.assert_allclose(ground.heights(places), 0.3 * u - 0.2 * v + 0.1 * u * v, atol=1e-12)


def test_a_hole_is_closed_from_a_metre_and_a_half_around():
    for radius, is_known in [(1.2, True), (2.4, False)]:
        points = floor(0.0, 8.0, 0.0, 8.0)
        points = points[np.hypot(points[:, 0] - 4.0, points[:, 1] - 4.0) > radius]
        assert np.isfinite(Ground(points).heights(np.array([[4.0, 4.0]]))[0]) == is_known


def test_what_is_within_thirty_centimeters_of_the_camera_is_in_its_way():
    """The camera is 1.2 m above the ground."""
    for height, is_free in [(0.89, True), (0.91, False), (1.51, True)]:
        thing = np.array([[4.0, 2.0, height]])
        area = area_of(np.concatenate([floor(0.0, 8.0), thing]))
        near = np.min(np.linalg.norm(area.middles - [4.0, 2.0], axis=1))
        assert (near < 0.2) == is_free
        if not is_free:
            assert 0.25 < near < 0.5  # the clearance


def sweep(height):
    """What a scanner sees of a flat court of 20 x 20 m, in its own frame."""
    a, e = np.meshgrid(np.radians(np.arange(0.0, 360.0, 0.5)), np.radians(np.arange(-25.0, 15.0, 0.6)))
    rays = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1).reshape(-1, 3)
    with np.errstate(divide="ignore"):
        ground = np.where(rays[:, 2] < 0.0, -height / rays[:, 2], np.inf)
    return rays * np.minimum(ground, 10.0 / np.abs(rays[:, :2]).max(axis=1))[:, None]


def test_the_place_of_the_scanner_is_in_the_area_of_its_sweep():
    points = sweep(1.8)  # the nearest ground is 3.9 m off
    np.testing.assert_allclose(Ground(points).heights(np.array([[0.0, 0.0], [2.0, -1.0]])), -1.8, atol=1e-9)
    assert area_of(points).contains(np.zeros((1, 2))).all()
    for other in (points + 3.0 * UP, sweep(3.8)):  # no ground; too high up
        assert np.isnan(Ground(other).heights(np.zeros((1, 2)))[0])
