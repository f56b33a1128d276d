"""What is known of a pose beforehand: in the normal equations, in the covariance, beside what images say."""

import numpy as np
import pytest

from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.photometric import PyramidParams, RegistrationParams, View, build_pyramid, prepare_reference
from sphere_nav.photometric.align.descent import kernels
from sphere_nav.photometric.align.esm import register_rig
from sphere_nav.photometric.align.expectation import NO_EXPECTATION, Expectation
from sphere_nav.photometric.align.rig import RigImage

HEIGHT_AND_TILT = np.diag([0.0, 0.0, 1.0, 1.0, 1.0, 0.0])
CAMERA = Pinhole(160, 120, 110.0, 110.0, 79.5, 59.5)
PARAMS = RegistrationParams(pyramid=PyramidParams(num_levels=3, min_side=24), max_pixels=20_000)
T_BODY_CAMERA = SE3.exp([0.4, 0.1, 0.2, 0.3, -1.2, 0.9])
TRUE = SE3.exp([0.2, -0.1, 0.1, 0.4, -1.0, 0.8])


@pytest.fixture(scope="module")
def seen(room):
    sphere = room.sphere(SE3.identity(), Spherical(512, 256), 0)
    view = View(prepare_reference(sphere.gray, sphere.range_m, sphere.camera, PARAMS), SE3.identity())
    return RigImage(build_pyramid(room.photograph(CAMERA, TRUE, 5), CAMERA, PARAMS.pyramid), None, (view,))


def test_it_pulls_by_its_information_and_beyond_two_deviations_no_harder():
    information = np.diag([4.0, 1.0, 9.0, 25.0, 16.0, 1.0])
    expected, H, before, after = Expectation(TRUE, information), np.zeros((6, 6)), np.zeros(6), np.zeros(6)
    xi = 1e-3 * np.array([2.0, -3.0, 1.0, 4.0, -2.0, 3.0])
    near = np.ascontiguousarray((TRUE @ SE3.exp(xi)).matrix[:3])
    kernels.add_expectation(near, expected.weighted(7.0), H, before)
    np.testing.assert_allclose(before, 7.0 * information @ xi, rtol=1e-2)
    np.testing.assert_allclose(H, 7.0 * information)
    for meters in (2.0, 20.0):  # 6 and 60 deviations in height
        far = TRUE @ SE3.exp([0.0, 0.0, meters, 0.0, 0.0, 0.0])
        after[:] = 0.0
        kernels.add_expectation(np.ascontiguousarray(far.matrix[:3]), expected.weighted(7.0), np.zeros((6, 6)), after)
        np.testing.assert_allclose(after[2], 7.0 * 2.0 * 3.0)


def test_a_wrong_expectation_moves_a_pose_that_the_image_fixes_by_less_than_a_millimetre(seen):
    alone = register_rig([seen], TRUE, PARAMS)
    wrong = Expectation(TRUE @ SE3.exp([0.0, 0.3, 0.4, 0.1, 0.0, 0.0]), HEIGHT_AND_TILT / 0.03**2)
    found = register_rig([seen], TRUE, PARAMS, expected=wrong)
    assert np.all(np.less(found.T_world_camera.distance(alone.T_world_camera), (0.001, 0.0005)))
    assert np.all(np.diagonal(found.covariance) <= np.diagonal(alone.covariance))


def test_a_sure_one_holds_the_pose_and_is_in_its_covariance_alone_and_on_a_body(seen):
    expected = Expectation(TRUE @ SE3.exp([0.0, 0.0, 0.001, 0.0, 0.0, 0.0]), 1e14 * HEIGHT_AND_TILT)
    found = register_rig([seen], TRUE, PARAMS, expected=expected)
    deviation = (expected.T_world_body.inverse() @ found.T_world_camera).log()
    np.testing.assert_allclose(deviation[2:5], 0.0, atol=2e-5)
    assert found.T_world_camera.distance(TRUE)[0] < 0.005
    assert np.diagonal(found.covariance)[2:5].max() < 1e-12
    A = T_BODY_CAMERA.inverse().adjoint()
    on_body = Expectation(expected.T_world_body @ T_BODY_CAMERA.inverse(), A.T @ expected.information @ A)
    image = RigImage(seen.pyramid, T_BODY_CAMERA, seen.views)
    other = register_rig([image], TRUE @ T_BODY_CAMERA.inverse(), PARAMS, expected=on_body)
    assert (other.T_world_camera @ T_BODY_CAMERA).distance(found.T_world_camera) < (1e-4, 1e-4)


def test_a_camera_on_level_ground_is_as_sure_of_its_height_and_tilt_as_the_ground_is_even(seen):
    alone = register_rig([seen], TRUE, PARAMS)
    known = np.linalg.inv(alone.covariance) * HEIGHT_AND_TILT
    found = register_rig([seen], TRUE, PARAMS, expected=Expectation(alone.T_world_camera, known))
    gained = np.linalg.inv(found.covariance) - np.linalg.inv(alone.covariance)
    np.testing.assert_allclose(np.diagonal(gained)[2:5], np.diagonal(known)[2:5], rtol=0.05)


def test_a_pose_by_images_and_what_was_expected_meet_where_both_are_as_sure():
    expected = Expectation(TRUE, 100.0 * HEIGHT_AND_TILT)
    step = np.array([0.3, 0.0, 0.02, 0.0, 0.0, 0.0])
    pose, covariance = expected.fuse(TRUE @ SE3.exp(step), 0.01 * np.eye(6))
    np.testing.assert_allclose((TRUE.inverse() @ pose).log(), step * [1.0, 1.0, 0.5, 1.0, 1.0, 1.0], atol=1e-9)
    np.testing.assert_allclose(np.diagonal(covariance), 0.01 / np.array([1, 1, 2, 2, 2, 1]))
    left = expected.resist(np.ones(6), TRUE, covariance)
    np.testing.assert_allclose(left, [1.0, 1.0, 0.5, 0.5, 0.5, 1.0])
    assert NO_EXPECTATION.fuse(pose, covariance) == (pose, covariance)
