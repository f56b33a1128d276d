"""Registered depth against a scene whose depth is known in closed form."""

import numpy as np
import pytest

from sphere_mapping.acquisition.partial.depth_registration import DepthRegistration, draw_nearest, sample_inverse
from sphere_nav.geometry import SE3, Pinhole, Spherical
from worlds.box_and_wall import depth_of_box_and_wall

DEPTH = Pinhole(320, 240, 290.0, 290.0, 160.0, 120.0)


@pytest.mark.parametrize("focal_length", [260.0, 400.0])
def test_every_pixel_that_both_see_is_right(focal_length):
    """Also where the target is finer than the depth camera: no holes; and at the edge of the box: no bleeding."""
    target = Pinhole(320, 240, focal_length, focal_length, 160.0, 120.0)
    T_target_depth = SE3.exp([0.05, 0.02, -0.01, 0.0, 0.01, 0.0])
    T_scene_depth = SE3.exp([0.1, 0.0, 0.0, 0.0, 0.1, 0.0])
    T_scene_target = T_scene_depth @ T_target_depth.inverse()
    measured = depth_of_box_and_wall(DEPTH, T_scene_depth).astype(np.float32)
    found = DepthRegistration(DEPTH, target, T_target_depth)(measured)
    expected = depth_of_box_and_wall(target, T_scene_target)
    is_found = np.isfinite(found)
    wrong = np.abs(found - expected)[is_found] > 0.01 * expected[is_found]
    assert wrong.sum() <= 240  # at most one pixel a row, at the edge of the box, is on the other face
    inner = is_found[30:-30, 60:-60]
    assert inner.mean() > 0.95  # the shadow of the box is at most 0.05 m / 3 m * 400 px = 7 of 200 columns wide


def test_the_nearer_surface_wins():
    """Seen from far to the side, the box hides what the depth camera sees of the wall."""
    measured = np.full((240, 320), 3.0, np.float32)
    measured[:, 140:180] = 1.0
    found = DepthRegistration(DEPTH, DEPTH, SE3.exp([0.3, 0, 0, 0, 0, 0]))(measured)
    near = np.flatnonzero(np.abs(found[120] - 1.0) < 0.01)
    assert near.min() == pytest.approx(140 + 0.3 * 290, abs=1)
    assert near.max() == pytest.approx(179 + 0.3 * 290, abs=1)


def test_the_nearest_of_points_hides_the_others_and_goes_round_the_back_of_a_sphere_only():
    whole, pinhole = Spherical(8, 4), Pinhole(8, 4, 4.0, 4.0, 3.5, 1.5)
    for camera, is_whole in ((whole, True), (pinhole, False)):
        pixels = np.array([[1.3, 1.0], [1.4, 1.2], [7.4, 0.0]])
        points = camera.unproject(pixels) * np.array([[5.0], [2.0], [3.0]])
        found = draw_nearest(np.vstack([points, [[np.nan] * 3]]), camera, 2)
        np.testing.assert_allclose(found[1:3, 1:3], 2.0, rtol=1e-6)
        np.testing.assert_allclose(found[:2, 7], 3.0, rtol=1e-6)
        np.testing.assert_allclose(found[0, 0], 3.0 if is_whole else np.inf, rtol=1e-6)
        assert np.count_nonzero(np.isfinite(found)) == (8 if is_whole else 6)


def test_inverse_depth_of_a_plane_is_sampled_exactly_and_edges_are_not_mixed():
    v, u = np.mgrid[0:6, 0:8].astype(np.float32)
    inverse = 0.5 + 0.003 * u - 0.002 * v
    inverse[:, 5:] = 0.1
    inverse[0, 0] = np.nan
    rng = np.random.default_rng(0)
    x, y = (rng.uniform(-0.49, last, (20, 25)).astype(np.float32) for last in (7.49, 5.49))
    sampled = sample_inverse(inverse, x, y)
    inner = (x >= 1) & (x <= 4) & (y >= 1) & (y <= 5)
    np.testing.assert_allclose(sampled[inner], (0.5 + 0.003 * x - 0.002 * y)[inner], rtol=1e-4)
    nearest = inverse[np.rint(y).astype(int), np.rint(x).astype(int)]
    edge = ((x > 4) & (x < 5)) | ((x < 1) & (y < 1))
    np.testing.assert_array_equal(sampled[edge], nearest[edge])
    beyond = np.float32([[-0.6, 7.6, 3.0, -1e4]])
    assert np.isnan(sample_inverse(inverse, beyond, np.float32([[3.0, 3.0, 5.6, -1e4]]))).all()
