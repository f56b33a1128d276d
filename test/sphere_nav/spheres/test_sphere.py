import numpy as np
import pytest

from sphere_nav.geometry import SE3, Spherical
from sphere_nav.spheres.coarse import coarse_sphere
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, Sphere, check_depth, continued
from worlds.room import wide_room

CAMERA = Spherical(16, 8)


def plane(value=2.0):
    return np.full((8, 16), value, dtype=np.float32)


def gray(value=100):
    return np.full((8, 16), value, dtype=np.uint8)


def test_optical_axes_become_body_axes():
    z_forward, x_right, y_down = np.eye(3)[[2, 0, 1]]
    found = T_BODY_OPTICAL.apply(np.array([z_forward, x_right, y_down]))
    np.testing.assert_array_equal(found, [[1, 0, 0], [0, -1, 0], [0, 0, -1]])


def test_points_are_where_their_pixels_look_and_unknown_ones_are_left_out():
    range_m = plane(3.0)
    range_m[:, :4] = np.nan
    range_m[:, 4:6] = np.inf
    points, values = Sphere(gray(), range_m, CAMERA).points()
    assert points.shape == (8 * 10, 3)
    assert values.shape == (8 * 10,)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 3.0, rtol=1e-6)
    range_m = plane()
    range_m[:] = np.arange(1.0, 9.0, dtype=np.float32)[:, None]
    image = np.arange(1, 129, dtype=np.uint8).reshape(8, 16)
    points, values = Sphere(image, range_m, CAMERA).points(step=3)
    v, u = np.mgrid[0:8:3, 0:16:3]
    np.testing.assert_array_equal(values, image[::3, ::3].ravel())
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), range_m[::3, ::3].ravel(), rtol=1e-6)
    np.testing.assert_allclose(CAMERA.project(points)[0], np.stack([u.ravel(), v.ravel()], axis=1), atol=1e-4)


def test_levels_of_a_gray_image_are_its_bytes_and_a_pixel_is_seen_if_it_is_lit_or_measured():
    image, range_m = gray(), plane()
    image[2, 3], range_m[2, 3] = 0, np.nan
    sphere = Sphere(image, range_m, CAMERA)
    assert sphere.levels.dtype == np.uint8
    np.testing.assert_array_equal(sphere.levels, sphere.gray)
    assert Sphere(np.dstack([image] * 3), range_m, CAMERA).levels.dtype == np.float32
    image, range_m = gray(), plane()
    image[0, :3], range_m[0, 1:] = 0, np.nan
    np.testing.assert_array_equal(Sphere(image, range_m, CAMERA).is_seen[0, :4], [True, False, False, True])


def test_bad_images_are_refused_in_one_line():
    for image, range_m, message in [
        (gray()[:4], plane(), "sphere image: expected 16 x 8 uint8, grey or RGB, found 16 x 4 uint8"),
        (gray().astype(np.float32), plane(), "sphere image: .* found 16 x 8 float32"),
        (gray(), plane().astype(np.float64), "sphere range: expected 16 x 8 float32, found 16 x 8 float64"),
        (gray(), plane(-1.0), "sphere range: expected positive metres, NaN or \\+Inf, found -1.0"),
        (gray(), plane(0.0), "sphere range: expected positive metres"),
    ]:
        with pytest.raises(ValueError, match=message) as caught:
            Sphere(image, range_m, CAMERA)
        assert "\n" not in str(caught.value)


def test_the_unknown_continues_the_nearest_known():
    values, is_known = np.arange(1, 10, dtype=np.uint8)[None].repeat(3, axis=0), np.zeros((3, 9), np.bool_)
    is_known[:, [1, 7]] = True
    np.testing.assert_array_equal(continued(values, is_known)[1], [2, 2, 2, 2, 8, 8, 8, 8, 8][:4] + [2] + [8] * 4)
    for same in (np.zeros_like(is_known), np.ones_like(is_known)):
        assert continued(values, same) is values


def test_a_depth_or_deviation_of_another_kind_or_size_is_refused():
    wrong = [((8, 16), np.uint16, "16 x 8 uint16"), ((8, 15), float, "15 x 8 f"), ((8, 16, 1), float, "16 x 8 x 1 f")]
    for shape, kind, found in wrong:
        with pytest.raises(ValueError, match=f"depth: expected 16 x 8 metres, found {found}"):
            check_depth(np.ones(shape, kind), CAMERA)
    for kind in (np.float32, np.float64):
        check_depth(np.ones((8, 16), kind), CAMERA)
    Sphere(gray(), plane(), CAMERA, range_std_m=plane(0.1))
    with pytest.raises(ValueError, match="sphere range std: expected positive metres"):
        Sphere(gray(), plane(), CAMERA, range_std_m=plane(0.0))


WINDOW = Spherical(270, 202, 1024.0, 300.0, 150.0)


@pytest.mark.parametrize("camera", [Spherical(512, 256), WINDOW], ids=["whole", "window"])
def test_it_shows_the_room_as_its_own_camera_sees_it(camera):
    room = wide_room()
    small = coarse_sphere(room.sphere(SE3.identity(), camera))
    gray, range_m = room.render(small.camera, SE3.identity())
    assert np.median(np.abs(small.image - gray)) < 4.0
    assert np.median(np.abs(small.range_m / range_m - 1.0)) < 0.02


def test_every_size_becomes_about_a_hundred_rows():
    for width, expected in [(2048, 256), (1024, 256), (512, 256), (300, 300)]:
        camera = Spherical(width, width // 2)
        image, range_m = np.full((width // 2, width), 9, np.uint8), np.ones((width // 2, width), np.float32)
        small = coarse_sphere(Sphere(image, range_m, camera))
        assert small.camera.is_whole
        assert (small.camera.width, small.image.min(), small.range_m.max()) == (expected, 9, 1.0)


def test_the_nearest_surface_of_a_block_counts_and_the_unknown_does_not():
    camera = Spherical(400, 200)
    range_m = np.full((200, 400), 20.0, np.float32)
    range_m[0, 0], range_m[:2, 2:4], range_m[0:2, 4:6], range_m[0, 4] = 2.0, np.nan, np.inf, np.nan
    small = coarse_sphere(Sphere(np.full((200, 400), 7, np.uint8), range_m, camera))
    assert small.camera.width == 200
    assert small.range_m[0, 0] == 2.0
    assert np.isnan(small.range_m[0, 1])
    assert small.range_m[0, 2] == np.inf
    assert small.range_m[0, 3] == 20.0
