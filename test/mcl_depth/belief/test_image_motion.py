"""Odometry against the images: a drive along a wall with pillars, every motion known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mcl_depth.belief.estimate import Observation
from mcl_depth.belief.image_motion import ReconciledOdometry, image_covariance, measure_motion
from mcl_depth.params import MotionParams
from sphere_nav.geometry import SE3, Spherical

CAMERA = Spherical(180, 90)
HALF = np.array([4.0, 3.0, 2.0])  # m, of a room around the origin
GRID = np.stack(np.meshgrid(np.arange(180), np.arange(90)), axis=-1)


def ranges_at(x, y):
    rays, place = CAMERA.unproject(GRID), np.array([x, y, 0.0])
    with np.errstate(divide="ignore"):
        return np.min((np.sign(rays) * HALF - place) / rays, axis=-1).astype(np.float32)


def image_at(x, y):
    """The room's walls with their pattern, as a camera of heading 0 sees them."""
    points = np.array([x, y, 0.0]) + ranges_at(x, y)[..., None] * CAMERA.unproject(GRID)
    pattern = np.sin(points @ [2.1, 1.3, 0.7]) + np.sin(points @ [-0.9, 2.3, 1.9]) + np.cos(points @ [1.7, -1.1, 2.7])
    return (128.0 + 40.0 * pattern).astype(np.float32)


class Room:
    camera = CAMERA

    def ranges_from(self, pose):
        return ranges_at(pose[0], pose[1])


def observe(image, odometry):
    return Observation(image, CAMERA, 1, np.eye(3), odometry and np.array(odometry))


def test_a_turned_camera_is_unsure_along_the_corridor():
    """Along stripes nothing tells how far it went, whichever way the camera looks."""
    for yaw in (0.0, 1.0):
        turn, images = SE3.from_planar(0.0, 0.0, yaw).rotation, []
        for x, rays in ((0.5, CAMERA.unproject(GRID)), (0.7, CAMERA.unproject(GRID) @ turn.T)):
            place = [x, 0.0, 0.0]
            with np.errstate(divide="ignore"):
                points = rays * np.min((np.sign(rays) * HALF - place) / rays, axis=-1)[..., None] + place
            stripes = np.sin(points @ [0.1, 3.3, 1.7]) + np.sin(points @ [-0.1, 2.3, 3.9])
            images.append((128.0 + 50.0 * stripes).astype(np.float32))
        found = ReconciledOdometry(Room(), MotionParams())
        found.keep(images[0], np.ones((90, 180), np.bool_), np.array([0.5, 0.0, 0.0]))
        step = measure_motion(found._view, Observation(images[1], CAMERA, 1, turn), np.array([0.15, 0.0, 0.0]))
        by_image = np.diag(step.covariance - image_covariance(float(np.hypot(*step.motion[:2]))))
        assert by_image[0] > 5.0 * by_image[1] > 0.0


def test_a_long_way_by_images_is_less_sure():
    expected = [0.03**2 + 0.4**2, 0.03**2 + 0.4**2, 101.0 * np.radians(0.3) ** 2]
    np.testing.assert_allclose(np.diag(image_covariance(10.0)), expected)


@pytest.fixture
def check():
    """What has seen two images half a metre apart, the second of them at (0.5, 0) and kept."""
    found = ReconciledOdometry(Room(), MotionParams())
    for x in (0.0, 0.5):
        found.reconcile(observe(image_at(x, 0.0), (x, 0.0, 0.0)), is_held=True)
        found.keep(image_at(x, 0.0), np.ones((90, 180), np.bool_), np.array([x, 0.0, 0.0]))
    return found


@pytest.mark.parametrize("odometry", [(0.5, 0.0, 0.0), (1.0, 0.0, 0.2)])
def test_wheels_that_stand_race_turn_or_slide_are_contradicted_and_the_motion_is_that_of_the_images(check, odometry):
    seen = check.reconcile(observe(image_at(1.0, 0.0), odometry), is_held=True)
    assert seen.is_contradicted
    assert seen.is_known
    np.testing.assert_allclose(seen.observation.odometry, [1.0, 0.0, 0.0], atol=0.03)


def test_reconciled_odometry_goes_on_from_where_it_was(check):
    check.reconcile(observe(image_at(1.0, 0.0), (0.5, 0.0, 0.0)), is_held=True)
    check.keep(image_at(1.0, 0.0), np.ones((90, 180), np.bool_), np.array([1.0, 0.0, 0.0]))
    seen = check.reconcile(observe(image_at(1.4, 0.0), (0.9, 0.0, 0.0)), is_held=True)
    assert not seen.is_contradicted
    np.testing.assert_allclose(seen.observation.odometry, [1.4, 0.0, 0.0], atol=0.04)


def test_an_image_of_another_place_leaves_the_motion_unknown_unless_images_never_fitted(check):
    strange = np.random.default_rng(0).uniform(0, 255, (90, 180)).astype(np.float32)
    seen = check.reconcile(observe(strange, (1.0, 0.0, 0.0)), is_held=True)
    assert (seen.is_contradicted, seen.is_known) == (True, False)
    check.forget()
    check.keep(image_at(0.5, 0.0), np.ones((90, 180), np.bool_), np.array([0.5, 0.0, 0.0]))
    assert not check.reconcile(observe(strange, (1.0, 0.0, 0.0)), is_held=True).is_contradicted


def test_after_a_gap_in_odometry_nobody_knows_the_way(check):
    image = image_at(1.0, 0.0)
    check.reconcile(replace(observe(image, None), stamp_ns=2 * 10**9), is_held=True)
    check.keep(image, np.ones((90, 180), np.bool_), np.array([1.0, 0.0, 0.0]))
    seen = check.reconcile(observe(image, (1.0, 0.0, 0.0)), is_held=True)
    assert not seen.step.is_known
    assert not seen.step.sigmas.any()  # by a clock that went back


def test_images_that_move_across_odometry_name_the_mounting(check):
    seen = check.reconcile(observe(image_at(1.0, 0.0), (0.5, -0.5, 0.0)), is_held=False)
    assert not seen.is_contradicted
    assert "the images 0.50 m at +90 deg to it" in seen.hint.detail
    assert "mounting" in seen.hint.advice
    np.testing.assert_allclose(seen.observation.odometry, [0.5, -0.5, 0.0], atol=1e-3)
