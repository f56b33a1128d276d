import numpy as np
import pytest

from sphere_mapping.acquisition.partial.window import full_width_for, upright_axes, window_of
from sphere_nav.geometry import SE3, Fisheye, Pinhole, Spherical
from sphere_nav.geometry.cameras.camera import pixel_grid
from sphere_nav.spheres.sphere import T_BODY_OPTICAL

WINDOW_LEVELS = 5

CAMERA = Pinhole(640, 480, 500.0, 500.0, 320.0, 240.0)


def rotated(tangent):
    return SE3.exp([0, 0, 0, *tangent]) @ T_BODY_OPTICAL


@pytest.mark.parametrize("tangent", [(0, 0, 3.1), (0.4, -0.3, 1.0)])
def test_every_ray_of_the_camera_falls_into_its_window(tangent):
    T_sphere_camera = rotated(tangent)
    window = window_of(CAMERA, T_sphere_camera, full_width_for(500.0))
    rays = CAMERA.unproject(pixel_grid(CAMERA)[::7, ::7]) @ T_sphere_camera.rotation.T
    assert window.project(rays)[1].all()


def test_every_pyramid_level_keeps_the_directions_of_the_window():
    window = window_of(CAMERA, rotated((0, 0, 0.7)), full_width_for(500.0))
    level = window
    for _ in range(WINDOW_LEVELS - 1):
        assert level.width % 2 == 0
        assert level.height % 2 == 0
        level = level.halve()
    corner = np.array([-0.5, -0.5])
    np.testing.assert_allclose(level.unproject(corner), window.unproject(corner), atol=1e-12)


def test_a_camera_that_looks_up_or_all_around_is_a_whole_sphere():
    panoramic = Fisheye(800, 800, 250.0, 250.0, 399.5, 399.5)
    full_width = full_width_for(250.0)
    assert window_of(panoramic, T_BODY_OPTICAL, full_width) == Spherical(full_width, full_width // 2)
    assert window_of(CAMERA, rotated((0, -np.pi / 2, 0)), full_width).is_whole


@pytest.mark.parametrize("angles", [(np.pi, 0.0, 0.0), (0.2, 0.6, -1.0)])
def test_spheres_are_upright_on_the_vehicle_with_the_camera_in_the_middle(angles):
    T_base_body = SE3.from_angles(*angles, [0.4, 0.0, 1.1])
    T_sphere_body = upright_axes(T_base_body, CAMERA)
    T_base_sphere = T_base_body @ T_sphere_body.inverse()
    np.testing.assert_allclose(T_base_sphere.rotation[:, 2], [0.0, 0.0, 1.0], atol=1e-12)
    assert T_sphere_body.yaw == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(T_base_sphere.translation, T_base_body.translation)


def test_spheres_have_the_axes_of_a_camera_that_is_nearly_upright_or_looks_into_a_pole():
    for angles in ((0.0, 0.0, 2.0), (0.0, 0.09, 0.0), (0.0, 1.2, 0.0), (np.pi, -np.pi / 2, 0.0)):
        np.testing.assert_array_equal(upright_axes(SE3.from_angles(*angles, np.zeros(3)), CAMERA).matrix, np.eye(4))
