"""The stacked normal equations against numerical derivatives of the residuals."""

import cv2
import numpy as np
import pytest

from sphere_nav.geometry import SE3, Fisheye, Pinhole, Spherical
from sphere_nav.photometric import PyramidParams, RegistrationParams, View, build_pyramid, prepare_reference
from sphere_nav.photometric.align.problem import AlignmentState, Problem
from sphere_nav.photometric.align.projection import in_blocks
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.photometric.align.rotation import correlate, correlation_after_turn, register_rotation
from sphere_nav.spheres.sphere import T_BODY_OPTICAL

CAMERA = Pinhole(160, 120, 110.0, 110.0, 79.5, 59.5)
RESIDUAL_SQUARED = 44  # the last product of the columns
T_WORLD_REFERENCE = SE3.from_planar(0.5, -0.4, 0.3) @ T_BODY_OPTICAL


def with_itself(image, range_m, params):
    """Return the comparison of an image with itself."""
    view = View(prepare_reference(image, range_m, CAMERA, params), T_WORLD_REFERENCE)
    seen = RigImage(build_pyramid(image, CAMERA, params.pyramid), views=(view,))
    return Problem.choose_pixels([seen], 0, T_WORLD_REFERENCE, params)


def cost(problem, T_world_camera):
    """Half the sum of squared residuals, all weights being one."""
    *_, (view,) = problem.compare(AlignmentState.start(T_world_camera, 1))
    return 0.5 * view.pieces[:, RESIDUAL_SQUARED].sum()


def test_the_normal_equations_are_those_of_numerical_derivatives_in_the_camera_tangent(room, monkeypatch):
    # no pixel weighs less: the cost is a plain sum of squares
    monkeypatch.setattr("sphere_nav.photometric.align.problem.ROBUST", (1000.0, 1.0))
    image, range_m = room.render(CAMERA, T_WORLD_REFERENCE)
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
    problem = with_itself(*room.render(CAMERA, T_WORLD_REFERENCE), RegistrationParams())
    *_, (found,) = problem.compare(AlignmentState.start(T_WORLD_REFERENCE, 1))
    # float32 pixels fall beside their centres by 1e-5; histogram bins are a quarter wide
    assert abs(found.median) < 0.25
    assert found.sigma == 1.0
    assert found.num_inliers == found.num_visible
    *_, (brighter,) = problem.compare(AlignmentState(T_WORLD_REFERENCE, np.array([[1.0, 40.0]])))
    assert abs(brighter.median - 40.0) < 0.25


PARAMS = RegistrationParams(pyramid=PyramidParams(num_levels=3, min_side=24))


def test_a_turn_of_five_degrees_is_found_and_none_in_even_images(room):
    turn = SE3.exp([0, 0, 0, 0.01, np.deg2rad(5), -0.01])
    before = build_pyramid(room.render(CAMERA, T_BODY_OPTICAL)[0], CAMERA, PARAMS.pyramid)
    now = build_pyramid(room.render(CAMERA, T_BODY_OPTICAL @ turn)[0], CAMERA, PARAMS.pyramid)
    found = register_rotation(now, before, PARAMS)
    assert found.distance(turn)[1] < np.deg2rad(0.3)
    assert np.array_equal(found.translation, np.zeros(3))
    even = build_pyramid(np.full((120, 160), 90, np.uint8), CAMERA, PARAMS.pyramid)
    assert np.array_equal(register_rotation(even, even, PARAMS).matrix, np.eye(4))


def test_images_correlate_after_the_turn_between_them(room):
    for camera in [CAMERA, Fisheye(160, 120, 60.0, 60.0, 79.5, 59.5, (0.02, 0, 0, 0)), Spherical(256, 128)]:
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
    image = room.render(CAMERA, T_BODY_OPTICAL)[0]
    level = build_pyramid(image, CAMERA, PARAMS.pyramid)
    even = build_pyramid(np.full(image.shape, 90, np.uint8), CAMERA, PARAMS.pyramid)
    assert correlation_after_turn(level, level, SE3.exp([0, 0, 0, 0, np.deg2rad(90), 0]).rotation) is None
    assert correlation_after_turn(level, even, np.eye(3)) is None


def test_a_correlation_is_of_what_is_in_view():
    """Points at the middle of pixels, some of them behind the camera; gain and offset do not count."""
    rng = np.random.default_rng(4)
    image = rng.uniform(20.0, 230.0, (CAMERA.height, CAMERA.width)).astype(np.float32)
    level = build_pyramid(image, CAMERA).levels[0]
    row, column = rng.integers(2, 90, 40), rng.integers(2, 90, 40)
    seen, other = image[row, column], image[row, column[::-1]]
    pixels = np.zeros((7, 40), np.float32)
    pixels[:3] = 3.0 * CAMERA.unproject(np.stack([column, row], axis=-1).astype(float)).T
    for gray, expected in ((seen, 1), (0.5 * seen + 20, 1), (255 - seen, -1), (other, np.corrcoef(seen, other)[0, 1])):
        pixels[3] = gray
        found, number = correlate(in_blocks(pixels), SE3.identity(), level)
        assert (found, number) == (pytest.approx(expected, abs=2e-3), 40)  # float32 falls beside a pixel by 1e-5
    pixels[:3, 15:] *= -1.0
    assert correlate(in_blocks(pixels), SE3.identity(), level)[1] == 15
