"""Ranges against ranges: motions come back, whatever the light; what does not hold is refused."""

from dataclasses import replace

import numpy as np
import pytest

from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.spheres.range_alignment import (
    DepthImage,
    RangeFit,
    RangeImage,
    align_ranges,
    assess_ranges,
    choose_points,
    measure_motion_by_ranges,
)
from sphere_nav.spheres.sphere import Sphere
from worlds.room import Room, optical, sharp_room

RANGE_TURN_SHARE = 0.05  # written out: imported, a change would go unseen

WHOLE = Spherical(256, 128)
WINDOW = Spherical(160, 110, 512.0, 176.0, 60.0)
T_A, T_B = SE3.from_planar(0.3, 0.2, 0.4), SE3.from_planar(0.6, -0.1, 0.55)
T_A_B = T_A.inverse() @ T_B
FROM_AFAR = [(WHOLE, 0.0, 3.0), (WHOLE, 0.005, 6.0), (WINDOW, 0.005, 12.0)]  # camera, noise, limit in mm


def ranges(pose, camera=WHOLE, noise=0.0):
    sphere = sharp_room().sphere(pose, camera)
    rng = np.random.default_rng(3)
    rough = sphere.range_m * (1.0 + noise * rng.normal(size=sphere.range_m.shape))
    dark = np.ones_like(sphere.image)  # light plays no part
    return RangeImage.from_sphere(Sphere(dark, rough.astype(np.float32), camera))


@pytest.mark.parametrize(("camera", "noise", "limit_mm"), FROM_AFAR)
def test_a_motion_is_found_from_afar(camera, noise, limit_mm):
    guess = T_A_B @ SE3.exp([0.15, -0.1, 0.08, 0.03, -0.04, 0.1])
    fit = measure_motion_by_ranges(ranges(T_A, camera, noise=noise), ranges(T_B, camera, noise=noise), guess)
    distance, angle = T_A_B.distance(fit.T_a_b)
    assert 1e3 * distance < limit_mm
    assert angle < np.radians(0.3)
    sigma_m = np.sqrt(np.trace(fit.covariance[:3, :3]) / 3)
    assert distance < 4.0 * sigma_m < (0.05 if camera.is_whole else 0.15)  # it knows how good it is; a turn counts


def test_a_motion_that_is_off_by_more_than_the_last_gate_does_not_fit():
    whole = [ranges(pose, noise=0.005) for pose in (T_A, T_B)]
    assert not assess_ranges(*whole, T_A_B @ SE3.exp([0.1, 0.1, 0.0, 0.0, 0.0, 0.0])).is_good
    window, depth = ranges(T_A, WINDOW), RangeImage.from_depth(depth_image(optical(T_A)))
    cases = [(*whole, T_A_B), (window, depth, T_A.inverse() @ optical(T_A))]
    fits = [assess_ranges(*case) for case in cases]
    worst = np.array([[np.linalg.eigvalsh(fit.covariance[p, p])[-1] for p in (slice(3), slice(3, 6))] for fit in fits])
    chosen = [case[1].points[choose_points(*case)] for case in cases]
    worst[:, 1] *= [np.median(np.linalg.norm(points, axis=1)) ** 2 for points in chosen]
    np.testing.assert_allclose([fit.sigma_m**2 for fit in fits], worst.max(axis=1))
    assert set(worst.argmax(axis=1)) == {0, 1}  # the turn tells the least, or the position


def test_a_single_wall_holds_no_motion_and_nothing_in_common_is_nothing():
    """It could be slid along: not observable."""
    rays = pixel_rays(WINDOW)
    wall = Sphere(np.ones(rays.shape[:2], np.uint8), (2.0 / rays[..., 0]).astype(np.float32), WINDOW)
    found = align_ranges(RangeImage.from_sphere(wall), RangeImage.from_sphere(wall), SE3.identity())
    assert found is None or not found.is_good
    back = SE3.from_planar(0.0, 0.0, np.pi)
    turned = RangeImage.from_sphere(Room().sphere(back, WINDOW))
    assert align_ranges(ranges(SE3.identity(), WINDOW), turned, back) is None


def test_what_is_not_measured_plays_no_part():
    sphere = sharp_room().sphere(T_B, WHOLE)
    holes = sphere.range_m.copy()
    holes[:, 40:110], holes[60:] = np.nan, np.inf
    fit = align_ranges(ranges(T_A), RangeImage.from_sphere(replace(sphere, range_m=holes)), T_A_B @ SE3.exp([0.05] * 6))
    assert T_A_B.distance(fit.T_a_b)[0] < 0.005


PINHOLE = Pinhole(128, 96, 90.0, 90.0, 63.5, 47.5)


def depth_image(T_room_camera):
    return DepthImage(sharp_room().rgbd(PINHOLE, T_room_camera)[1], PINHOLE, SE3.identity())


@pytest.mark.parametrize("camera", [WHOLE, WINDOW])
def test_a_depth_image_is_placed_in_a_sphere_both_ways(camera):
    T_room_camera = optical(T_B)
    true = T_A.inverse() @ T_room_camera
    guess = true @ SE3.exp([0.1, -0.05, 0.08, 0.03, -0.04, 0.02])
    fit = measure_motion_by_ranges(ranges(T_A, camera), RangeImage.from_depth(depth_image(T_room_camera)), guess)
    distance, angle = true.distance(fit.T_a_b)
    assert 1e3 * distance < 6.0
    assert angle < np.radians(0.3)


GOOD = RangeFit(SE3.from_planar(0.6, 0.8, 0.3), 1e-6 * np.eye(6), 0.9, 0.8, 0.001)


def both_ways(monkeypatch, gap):
    """Return what both ways make of a forward motion of 1 m and one back that is off by a gap (6,)."""
    fits = iter((GOOD, replace(GOOD, T_a_b=SE3.exp(gap) @ GOOD.T_a_b.inverse())))
    monkeypatch.setattr("sphere_nav.spheres.range_alignment.align_ranges", lambda *_: next(fits))
    return measure_motion_by_ranges(None, None, SE3.identity())


def test_both_ways_agree_within_their_gap(monkeypatch):
    for axis, limit in [(0, 0.07), (1, -0.07), (2, 0.07), (3, 0.02), (4, -0.02), (5, 0.02)]:
        assert both_ways(monkeypatch, 0.999 * limit * np.eye(6)[axis]) is not None
        assert both_ways(monkeypatch, 1.001 * limit * np.eye(6)[axis]) is None
    floor = np.diagonal(both_ways(monkeypatch, np.zeros(6)).covariance - GOOD.covariance)
    np.testing.assert_allclose(np.sqrt(floor), np.repeat([0.005 + 0.005, 0.002], 3))  # where they agree, a metre apart


def test_the_points_of_a_depth_image_are_those_of_the_surfaces_and_depth_of_zero_is_none():
    pose = optical(T_B)
    depth = depth_image(pose)
    image = RangeImage.from_depth(depth)
    known = image.points[image.rows]
    np.testing.assert_allclose(np.max(np.abs(pose.apply(known)) / sharp_room().half, axis=1), 1.0, atol=0.01)
    assert np.all(np.sum(image.normals[image.rows] * known, axis=1) < 0.0)  # towards the camera
    holes = depth.depth_m.copy()
    holes[:, :40] = 0.0
    image = RangeImage.from_depth(replace(depth, depth_m=holes))
    assert np.all(np.isnan(image.range_m[:, :40]))
    assert np.all(np.isfinite(image.range_m[:, 41:]))


def test_a_turn_between_two_views_makes_a_motion_less_sure(monkeypatch):
    """Of views, not of axes: a sphere's look ahead, a camera's along z."""
    window, turned = ranges(T_A, WINDOW), T_A @ SE3.exp([0, 0, 0, 0, 0, 0.3])

    def added(a, pose):
        case = a, RangeImage.from_depth(depth_image(pose)), T_A.inverse() @ pose
        covariances = []
        for share in (RANGE_TURN_SHARE, 0.0):
            monkeypatch.setattr("sphere_nav.spheres.range_alignment.RANGE_TURN_SHARE", share)
            covariances.append(assess_ranges(*case).covariance)
        typical_m = np.median(np.linalg.norm(case[1].points[choose_points(*case)], axis=1))
        return np.diagonal(covariances[0] - covariances[1]) / np.repeat([typical_m**2, 1.0], 3)

    for T_room_body, expected in ((T_A, 0.0), (turned, 0.3)):
        found = added(window, optical(T_room_body))
        np.testing.assert_allclose(found, (RANGE_TURN_SHARE * expected) ** 2, atol=1e-12)
    np.testing.assert_array_equal(added(ranges(T_A), optical(turned)), 0.0)
