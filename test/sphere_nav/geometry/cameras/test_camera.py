"""Laws that every camera model obeys."""

import numpy as np
import pytest

from sphere_nav.geometry import DoubleSphere, Fisheye
from sphere_nav.geometry.cameras.camera import pixel_grid
from sphere_nav.geometry.cameras.pinhole import Pinhole
from sphere_nav.geometry.cameras.spherical import Spherical, level_cameras


def pixel_distance(a, b, camera):
    """Distance (N,) in pixels, over the seam where the camera has one."""
    between = np.abs(a - b)
    if isinstance(camera, Spherical):
        between[..., 0] = np.minimum(between[..., 0], camera.full_width - between[..., 0])
    return np.linalg.norm(between, axis=-1)


def test_project_undoes_unproject(camera, pixels):
    found, visible = camera.project(camera.unproject(pixels))
    assert np.all(visible)
    assert pixel_distance(found, pixels, camera).max() < 1e-6


def test_J_project_equals_central_differences(camera, visible_points):
    horizontal = np.linalg.norm(visible_points[:, :2], axis=-1)
    points = visible_points[horizontal > 0.05 * np.linalg.norm(visible_points, axis=-1)]  # not at the poles
    points = points / np.linalg.norm(points, axis=-1, keepdims=True)
    step = 1e-6
    numeric = np.empty((len(points), 2, 3))
    for axis, direction in enumerate(np.eye(3)):
        difference = camera.project(points + step * direction)[0] - camera.project(points - step * direction)[0]
        if isinstance(camera, Spherical):
            period = camera.full_width
            difference[:, 0] = (difference[:, 0] + period / 2) % period - period / 2
        numeric[:, :, axis] = difference / (2 * step)
    good = np.isfinite(numeric).all(axis=(1, 2))  # the step may leave the area where the model has rays
    assert good.mean() > 0.98
    scale = np.linalg.norm(numeric[good], axis=(1, 2))
    error = np.linalg.norm(camera.J_project(points)[good] - numeric[good], axis=(1, 2))
    assert (error / scale).max() < 1e-6  # step^2 of truncation, 1e-16 / step of rounding


def test_pixels_per_radian_is_the_resolution_at_the_axis(camera):
    forward = [1.0, 0, 0] if isinstance(camera, Spherical) else [0, 0, 1.0]
    J = camera.J_project(np.array(forward))
    area = np.sqrt(np.linalg.det(J @ J.T))
    assert np.sqrt(area) == pytest.approx(camera.pixels_per_radian, rel=1e-6)


def test_an_image_of_half_the_magnification_has_the_same_rays_nearer_to_the_centre(camera, pixels):
    if isinstance(camera, Spherical):
        pytest.skip("a sphere has no lens")
    center = np.array([camera.cx, camera.cy])
    nearer = 0.5 * (pixels - center) + center
    np.testing.assert_allclose(camera.scaled(0.5).unproject(nearer), camera.unproject(pixels), atol=1e-9)


def test_halved_camera_sees_the_same_direction_at_the_middle_of_four_pixels(camera, pixels):
    half = camera.halve()
    assert (half.width, half.height) == (camera.width // 2, camera.height // 2)
    inner = pixels[(pixels[:, 0] < 2 * half.width - 0.5) & (pixels[:, 1] < 2 * half.height - 0.5)]
    np.testing.assert_allclose(half.unproject((inner + 0.5) / 2 - 0.5), camera.unproject(inner), atol=1e-9)
    assert half.pixels_per_radian == pytest.approx(camera.pixels_per_radian / 2)


def test_points_without_direction_or_beyond_half_a_pixel_from_the_outer_centers_are_not_visible(camera):
    found, visible = camera.project([[0.0, 0.0, 0.0], [np.nan, 1.0, 1.0]])
    assert not visible.any()
    assert not np.isfinite(found).all(axis=-1).any()
    if isinstance(camera, Spherical) and camera.is_whole:
        return  # without a border
    corners = np.array([[-0.5 + 1e-6, 0.0], [-0.5 - 1e-3, camera.height / 2], [camera.width - 0.499, 20.0]])
    rays = camera.unproject(corners)
    visible = camera.project(rays)[1]
    assert not visible[1:].any()
    assert visible[0] == np.isfinite(rays[0]).all()


def test_batch_shapes_are_kept(camera, visible_points):
    points = visible_points[:12].reshape(2, 6, 3)
    found, visible = camera.project(points)
    assert found.shape == (2, 6, 2)
    assert visible.shape == (2, 6)
    assert camera.J_project(points).shape == (2, 6, 2, 3)
    assert camera.unproject(found).shape == (2, 6, 3)
    np.testing.assert_array_equal(found[1, 2], camera.project(points[1, 2])[0])


def test_an_uncalibrated_camera_an_empty_image_or_an_impossible_sphere_is_refused():
    for model in [Pinhole, Fisheye, DoubleSphere]:
        for focal in [(0.0, 1.0), (1.0, -1.0), (np.nan, 1.0), (np.inf, 1.0)]:
            with pytest.raises(ValueError, match="focal length: expected positive"):
                model(4, 4, *focal, 2.0, 2.0)
    for make in [lambda w, h: Pinhole(w, h, 1, 1, 0, 0), lambda w, h: Fisheye(w, h, 1, 1, 0, 0), Spherical]:
        with pytest.raises(ValueError, match=r"camera size: expected at least 1 x 1, .* found 0 x 4"):
            make(0, 4)
    for arguments in [(512, 512), (200, 100, 100.0), (4, 2, np.nan), (4, 2, 8.0, np.inf)]:
        with pytest.raises(ValueError, match="sphere"):
            Spherical(*arguments)


SPHERE = Spherical(512, 256)


def test_axes_are_where_the_conventions_say_and_backward_lies_on_the_seam_from_both_sides():
    looks = {"forward": [1, 0, 0], "left": [0, 1, 0], "right": [0, -1, 0], "up": [0, 0, 1], "down": [0, 0, -1]}
    found = {name: SPHERE.project(np.array(point, float))[0] for name, point in looks.items()}
    np.testing.assert_allclose(found["forward"], [255.5, 127.5])
    np.testing.assert_allclose(found["left"], [127.5, 127.5])
    np.testing.assert_allclose(found["right"], [383.5, 127.5])
    assert found["up"][1] == pytest.approx(-0.5)
    assert found["down"][1] == pytest.approx(255.5)
    left, right = SPHERE.project([[-1.0, 1e-9, 0.0], [-1.0, -1e-9, 0.0]])[0][:, 0]
    assert left == pytest.approx(-0.5, abs=1e-6)
    assert right == pytest.approx(511.5, abs=1e-6)
    np.testing.assert_allclose(SPHERE.unproject([[-3.0, 100.0]]), SPHERE.unproject([[509.0, 100.0]]), atol=1e-12)


def test_a_window_is_a_cut_of_the_whole_sphere_and_does_not_see_what_is_outside():
    for offset_u in [0.0, 100.5, 420.0, 511.0]:
        window = Spherical(200, 100, 512.0, offset_u, 80.0)
        grid = pixel_grid(window)
        whole = grid + np.array([offset_u, 80.0])
        np.testing.assert_allclose(window.unproject(grid), SPHERE.unproject(whole), atol=1e-12)
        found, visible = window.project(SPHERE.unproject(whole))
        assert visible.all()
        np.testing.assert_allclose(found, grid, atol=1e-9)
    window = Spherical(200, 100, 512.0, 420.0, 80.0)
    outside = np.array([[-2.0, 50.0], [201.0, 50.0], [100.0, -2.0], [100.0, 101.0]])
    assert not window.project(window.unproject(outside))[1].any()


def test_levels_end_where_a_whole_sphere_has_no_half_or_a_side_gets_short():
    odd, short, few = level_cameras(Spherical(40, 20), 1), level_cameras(SPHERE, 100), level_cameras(SPHERE, 1, 2)
    assert (odd[-1].width, short[-1].width, few[-1].width) == (10, 256, 256)


def test_the_derivative_stays_finite_at_the_poles():
    assert np.isfinite(SPHERE.J_project([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])).all()
