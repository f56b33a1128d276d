"""Cameras that are one body; an expectation; the stacked normal equations against numerical derivatives."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from sphere_nav.geometry import SE3, Fisheye, FrameMotion, Pinhole, Spherical
from sphere_nav.photometric import PyramidParams, RegistrationParams, View, build_pyramid, prepare_reference
from sphere_nav.photometric.align.descent import kernels
from sphere_nav.photometric.align.esm import correlate, correlation_after_turn, register_rig, register_rotation
from sphere_nav.photometric.align.problem import (
    NO_EXPECTATION,
    AlignmentState,
    Expectation,
    Problem,
    RigImage,
    image_overlap,
)
from sphere_nav.photometric.checks.lens import measure_stretches
from sphere_nav.photometric.checks.structure import find_rig_structure
from sphere_nav.photometric.pixels.pyramid import in_blocks
from sphere_nav.spheres.sphere import T_BODY_OPTICAL

PINHOLE = Pinhole(160, 120, 110.0, 110.0, 79.5, 59.5)
FISHEYE = Fisheye(160, 120, 60.0, 60.0, 79.5, 59.5, (0.02, -0.01, 0.0, 0.0))
PARAMS = RegistrationParams(pyramid=PyramidParams(num_levels=3, min_side=24), max_pixels=20_000)
# One camera looks ahead and a little down, the other one back and to the side; both are off the middle of the body.
MOUNTS = (
    SE3.exp([0.4, 0.1, 0.2, 0.0, 0.1, 0.2]) @ T_BODY_OPTICAL,
    SE3.exp([-0.3, -0.2, 0.1, 0.0, 0.0, 2.4]) @ T_BODY_OPTICAL,
)
CAMERAS = PINHOLE, FISHEYE
T_ROOM_BODY = SE3.exp([0.3, -0.2, 0.1, 0.0, 0.0, 0.1])
START = T_ROOM_BODY @ SE3.exp([0.03, -0.04, 0.02, 0.01, -0.01, 0.02])


@pytest.fixture(scope="module")
def views(room):
    places = [SE3.identity(), SE3.from_planar(0.8, 0.1, 0.0)]
    spheres = [room.sphere(T, Spherical(512, 256), k) for k, T in enumerate(places)]
    references = [prepare_reference(one.gray, one.range_m, one.camera, PARAMS) for one in spheres]
    return tuple(View(one, T) for one, T in zip(references, places, strict=True))


def seen(room, k, T_room_body, views):
    """Return what a camera of the body sees."""
    picture = room.photograph(CAMERAS[k], T_room_body @ MOUNTS[k], 50 + k)
    return RigImage(build_pyramid(picture, CAMERAS[k], PARAMS.pyramid), MOUNTS[k], views, f"camera{k}")


@pytest.fixture(scope="module")
def images(room, views):
    return tuple(seen(room, k, T_ROOM_BODY, views) for k in range(2))


def test_the_increment_of_a_camera_is_the_adjoint_of_that_of_the_body(images):
    problem, state = Problem.choose_pixels(images, 1, START, PARAMS), AlignmentState.start(START, 4)
    H, g, found = problem.compare(state)
    visible = sum(one.num_visible for one in found)
    for image in images:
        step = 1e-6 * np.eye(6)
        X, start = image.T_body_camera, image.pose(START)
        numeric = np.stack([(X.inverse() @ SE3.exp(xi) @ X).log() for xi in step], axis=1) / 1e-6
        moved = image.motion(FrameMotion(START @ SE3.exp(np.full(6, -0.05)), 0.5)).twist(start)
        np.testing.assert_allclose(moved, 0.025 * numeric.sum(axis=1), atol=1e-6)  # within a frame, too
        one = Problem.choose_pixels([replace(image, T_body_camera=None)], 1, start, PARAMS)
        h, q, found = one.compare(AlignmentState.start(start, 2))
        H[:6, :6] -= numeric.T @ h[:6, :6] @ numeric
        g[:6] -= numeric.T @ q[:6]
        visible -= sum(view.num_visible for view in found)
    np.testing.assert_allclose(H[:6, :6], 0.0, atol=1e-4 * np.abs(h[:6, :6]).max())
    np.testing.assert_allclose(g[:6], 0.0, atol=1e-4 * np.abs(q[:6]).max())
    assert visible == 0
    assert H.shape == (14, 14)
    assert np.all(H[6:10, 10:] == 0.0)  # the light of one camera says nothing of the other's
    T_camera_body = np.ascontiguousarray(X.inverse().matrix[:3])
    xi = X.adjoint() @ [0.3, 0.0, 0.4, 0.0, 0.6, 0.8]
    assert kernels.image_motion(xi, T_camera_body, 100.0, 4.0) == pytest.approx(100.0 * (1.0 + 0.5 / 4.0))


def test_two_cameras_find_their_motion(images):
    found = register_rig(images, START, PARAMS)
    assert found.is_converged
    assert len(found.gains) == 4
    meters, radians = found.T_world_camera.distance(T_ROOM_BODY)
    assert meters < 0.003  # noise of 2 grey levels: each camera alone errs by 2 to 4 mm
    assert radians < 0.0015
    xi = (found.T_world_camera.inverse() @ T_ROOM_BODY).log()
    assert xi @ np.linalg.solve(found.covariance, xi) < 25.0  # 6 degrees of freedom, 1 in 3000
    assert find_rig_structure(images, found, PARAMS).agreement > 0.5
    lenses, _ = measure_stretches(images, found, PARAMS)
    assert [one.camera for one in lenses] == [image.name for image in images]
    assert max(abs(one.share) for one in lenses) < 0.02


TWO_LEVELS = RegistrationParams(pyramid=PyramidParams(num_levels=2, min_side=8))


def overlap(range_m, turn=0.0):
    image = np.zeros((120, 160), np.uint8)
    view = View(prepare_reference(image, range_m, PINHOLE, TWO_LEVELS), SE3.identity())
    cameras = build_pyramid(image, PINHOLE, TWO_LEVELS.pyramid).cameras
    return image_overlap(cameras, [view], SE3.exp([0, 0, 0, 0, turn, 0]))


def test_what_comes_into_view_or_has_no_range_is_not_covered():
    range_m = np.full((120, 160), 3.0, np.float32)
    assert overlap(range_m) > 0.95  # all but its border
    assert 0.35 < overlap(range_m, turn=np.arctan(80 / 110)) < 0.6  # by half of the field of view
    assert overlap(range_m, turn=np.pi) == 0.0
    range_m[:, 80:] = np.nan
    assert abs(overlap(range_m) - 0.5) < 0.05


HEIGHT_AND_TILT = np.diag([0.0, 0.0, 1.0, 1.0, 1.0, 0.0])
T_BODY_CAMERA = SE3.exp([0.4, 0.1, 0.2, 0.3, -1.2, 0.9])
TRUE = SE3.exp([0.2, -0.1, 0.1, 0.4, -1.0, 0.8])


@pytest.fixture(scope="module")
def of_sphere(room):
    sphere = room.sphere(SE3.identity(), Spherical(512, 256), 0)
    view = View(prepare_reference(sphere.gray, sphere.range_m, sphere.camera, PARAMS), SE3.identity())
    return RigImage(build_pyramid(room.photograph(PINHOLE, TRUE, 5), PINHOLE, PARAMS.pyramid), None, (view,))


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


def test_a_wrong_expectation_moves_a_pose_that_the_image_fixes_by_less_than_a_millimetre(of_sphere):
    alone = register_rig([of_sphere], TRUE, PARAMS)
    wrong = Expectation(TRUE @ SE3.exp([0.0, 0.3, 0.4, 0.1, 0.0, 0.0]), HEIGHT_AND_TILT / 0.03**2)
    found = register_rig([of_sphere], TRUE, PARAMS, expected=wrong)
    assert np.all(np.less(found.T_world_camera.distance(alone.T_world_camera), (0.001, 0.0005)))
    assert np.all(np.diagonal(found.covariance) <= np.diagonal(alone.covariance))


def test_a_sure_one_holds_the_pose_and_is_in_its_covariance_alone_and_on_a_body(of_sphere):
    expected = Expectation(TRUE @ SE3.exp([0.0, 0.0, 0.001, 0.0, 0.0, 0.0]), 1e14 * HEIGHT_AND_TILT)
    found = register_rig([of_sphere], TRUE, PARAMS, expected=expected)
    deviation = (expected.T_world_body.inverse() @ found.T_world_camera).log()
    np.testing.assert_allclose(deviation[2:5], 0.0, atol=2e-5)
    assert found.T_world_camera.distance(TRUE)[0] < 0.005
    assert np.diagonal(found.covariance)[2:5].max() < 1e-12
    A = T_BODY_CAMERA.inverse().adjoint()
    on_body = Expectation(expected.T_world_body @ T_BODY_CAMERA.inverse(), A.T @ expected.information @ A)
    image = RigImage(of_sphere.pyramid, T_BODY_CAMERA, of_sphere.views)
    other = register_rig([image], TRUE @ T_BODY_CAMERA.inverse(), PARAMS, expected=on_body)
    assert (other.T_world_camera @ T_BODY_CAMERA).distance(found.T_world_camera) < (1e-4, 1e-4)


def test_a_camera_on_level_ground_is_as_sure_of_its_height_and_tilt_as_the_ground_is_even(of_sphere):
    alone = register_rig([of_sphere], TRUE, PARAMS)
    known = np.linalg.inv(alone.covariance) * HEIGHT_AND_TILT
    found = register_rig([of_sphere], TRUE, PARAMS, expected=Expectation(alone.T_world_camera, known))
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


RESIDUAL_SQUARED = 44  # the last product of the columns
T_WORLD_REFERENCE = SE3.from_planar(0.5, -0.4, 0.3) @ T_BODY_OPTICAL


def with_itself(image, range_m, params):
    """Return the comparison of an image with itself."""
    view = View(prepare_reference(image, range_m, PINHOLE, params), T_WORLD_REFERENCE)
    seen = RigImage(build_pyramid(image, PINHOLE, params.pyramid), views=(view,))
    return Problem.choose_pixels([seen], 0, T_WORLD_REFERENCE, params)


def cost(problem, T_world_camera):
    """Half the sum of squared residuals, all weights being one."""
    *_, (view,) = problem.compare(AlignmentState.start(T_world_camera, 1))
    return 0.5 * view.pieces[:, RESIDUAL_SQUARED].sum()


def test_the_normal_equations_are_those_of_numerical_derivatives_in_the_camera_tangent(room, monkeypatch):
    # no pixel weighs less: the cost is a plain sum of squares
    monkeypatch.setattr("sphere_nav.photometric.align.problem.ROBUST", (1000.0, 1.0))
    image, range_m = room.render(PINHOLE, T_WORLD_REFERENCE)
    smooth = cv2.GaussianBlur(image, (0, 0), 3.0)  # so that central differences are the derivative
    problem = with_itself(smooth, range_m, RegistrationParams())
    T_start = T_WORLD_REFERENCE @ SE3.exp([1e-3, 0, 0, 0, 1e-3, 0])  # off the pixel centres, residuals not zero
    H, g, (compared,) = problem.compare(AlignmentState.start(T_start, 1))
    H, g, step = H[:6, :6] * compared.sigma**2, g[:6] * compared.sigma**2, 2e-3
    scale = np.sqrt(np.diag(H))
    sides = [[cost(problem, T_start @ SE3.exp(s * step * axis)) for s in (1, 0, -1)] for axis in np.eye(6)]
    slope = np.array([(high - low) / (2 * step) for high, _, low in sides])
    curvature = np.array([(high - 2 * middle + low) / step**2 for high, middle, low in sides])
    assert np.abs((g - slope) / scale).max() < 0.03 * np.linalg.norm(slope / scale)
    assert np.abs(curvature / np.diag(H) - 1.0).max() < 0.05


def test_an_image_compared_with_itself_has_no_residual(room):
    problem = with_itself(*room.render(PINHOLE, T_WORLD_REFERENCE), RegistrationParams())
    *_, (found,) = problem.compare(AlignmentState.start(T_WORLD_REFERENCE, 1))
    # float32 pixels fall beside their centres by 1e-5; histogram bins are a quarter wide
    assert abs(found.median) < 0.25
    assert found.sigma == 1.0
    assert found.num_inliers == found.num_visible
    *_, (brighter,) = problem.compare(AlignmentState(T_WORLD_REFERENCE, np.array([[1.0, 40.0]])))
    assert abs(brighter.median - 40.0) < 0.25


def test_a_turn_of_five_degrees_is_found_and_none_in_even_images(room):
    turn = SE3.exp([0, 0, 0, 0.01, np.deg2rad(5), -0.01])
    before = build_pyramid(room.render(PINHOLE, T_BODY_OPTICAL)[0], PINHOLE, PARAMS.pyramid)
    now = build_pyramid(room.render(PINHOLE, T_BODY_OPTICAL @ turn)[0], PINHOLE, PARAMS.pyramid)
    found = register_rotation(now, before, PARAMS)
    assert found.distance(turn)[1] < np.deg2rad(0.3)
    assert np.array_equal(found.translation, np.zeros(3))
    even = build_pyramid(np.full((120, 160), 90, np.uint8), PINHOLE, PARAMS.pyramid)
    assert np.array_equal(register_rotation(even, even, PARAMS).matrix, np.eye(4))


def test_images_correlate_after_the_turn_between_them(room):
    for camera in [PINHOLE, Fisheye(160, 120, 60.0, 60.0, 79.5, 59.5, (0.02, 0, 0, 0)), Spherical(256, 128)]:
        turn = SE3.exp([0, 0, 0, 0.01, np.deg2rad(8), -0.01])
        before, now = (
            build_pyramid(room.render(camera, pose)[0], camera, PARAMS.pyramid)
            for pose in (T_BODY_OPTICAL, T_BODY_OPTICAL @ turn)
        )
        right = correlation_after_turn(now, before, turn.rotation)
        assert right > 0.97
        assert correlation_after_turn(now, before, np.eye(3)) < 1.0 - 5.0 * (1.0 - right)
        assert correlation_after_turn(before, before, np.eye(3)) == pytest.approx(1.0, abs=1e-5)


def test_images_that_share_little_or_show_nothing_do_not_correlate(room):
    image = room.render(PINHOLE, T_BODY_OPTICAL)[0]
    level = build_pyramid(image, PINHOLE, PARAMS.pyramid)
    even = build_pyramid(np.full(image.shape, 90, np.uint8), PINHOLE, PARAMS.pyramid)
    assert correlation_after_turn(level, level, SE3.exp([0, 0, 0, 0, np.deg2rad(90), 0]).rotation) is None
    assert correlation_after_turn(level, even, np.eye(3)) is None


def test_a_correlation_is_of_what_is_in_view():
    """Points at the middle of pixels, some of them behind the camera; gain and offset do not count."""
    rng = np.random.default_rng(4)
    image = rng.uniform(20.0, 230.0, (PINHOLE.height, PINHOLE.width)).astype(np.float32)
    level = build_pyramid(image, PINHOLE).levels[0]
    row, column = rng.integers(2, 90, 40), rng.integers(2, 90, 40)
    seen, other = image[row, column], image[row, column[::-1]]
    pixels = np.zeros((7, 40), np.float32)
    pixels[:3] = 3.0 * PINHOLE.unproject(np.stack([column, row], axis=-1).astype(float)).T
    for gray, expected in ((seen, 1), (0.5 * seen + 20, 1), (255 - seen, -1), (other, np.corrcoef(seen, other)[0, 1])):
        pixels[3] = gray
        found, number = correlate(in_blocks(pixels), SE3.identity(), level)
        assert (found, number) == (pytest.approx(expected, abs=2e-3), 40)  # float32 falls beside a pixel by 1e-5
    pixels[:3, 15:] *= -1.0
    assert correlate(in_blocks(pixels), SE3.identity(), level)[1] == 15
