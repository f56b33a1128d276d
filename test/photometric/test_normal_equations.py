"""One view compared with an image."""

import numpy as np
import pytest

from photometric import RegistrationParams, build_pyramid, prepare_reference
from photometric.normal_equations import ViewSolver
from sphere_geometry import SE3, Pinhole

CAMERA = Pinhole(160, 120, 110.0, 110.0, 79.5, 59.5)
T_ROOM_CAMERA = SE3.from_parts([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], [0, 0, 0])
PARAMS = RegistrationParams()


@pytest.fixture
def solver(room):
    image, range_m = room.render(CAMERA, T_ROOM_CAMERA)
    pixels = prepare_reference(image, range_m, CAMERA).levels[0]
    return ViewSolver(pixels, build_pyramid(image, CAMERA).levels[0])


def test_an_image_compared_with_itself_has_no_residual(solver):
    found = solver.compare(SE3.identity(), 1.0, 0.0, PARAMS)
    # float32 pixels fall beside their centres by 1e-5, the outermost ones out of the image
    assert np.nanmax(np.abs(found.residual)) < 0.05
    assert found.sigma == PARAMS.min_sigma
    assert found.num_inliers == found.num_visible
    assert np.allclose(found.H, found.H.T)


def test_gain_and_bias_are_taken_off(solver):
    found = solver.compare(SE3.identity(), 2.0, -10.0, PARAMS)
    expected = 2.0 * solver.pixels.intensity - 10.0 - solver.pixels.intensity
    assert np.nanmax(np.abs(found.residual - expected)) < 0.1


def test_a_reference_behind_the_camera_is_not_visible(solver):
    turned = SE3.exp([0, 0, 0, 0, np.pi, 0])
    found = solver.compare(turned, 1.0, 0.0, PARAMS)
    assert found.num_visible == 0
    assert np.isnan(found.residual).all()
    assert not found.H.any()
