"""Views of a room against the room itself, seen from the same place."""

import numpy as np

from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.spheres.sphere import Sphere
from sphere_nav.view_synthesis import kernels
from sphere_nav.view_synthesis.surface import surface_of
from sphere_nav.view_synthesis.synthesis import PlacedSurface, _colors_at, blend_weights, synthesize, warm_up
from worlds.room import optical

SPHERE = Spherical(512, 256)
PINHOLE = Pinhole(160, 120, 100.0, 100.0, 79.5, 59.5)
T_SPHERES = (SE3.identity(), SE3.from_planar(0.8, 0.0, 0.6))


def placed(room):
    spheres = [surface_of(room.sphere(T, SPHERE)) for T in T_SPHERES]
    return [PlacedSurface(*one, 0.5) for one in zip(spheres, T_SPHERES, strict=True)]


def psnr(view, gray):
    error = (view.image[..., 0].astype(float) - gray)[view.is_known]
    return 10 * np.log10(255**2 / np.mean(error**2))


def test_from_its_own_place_a_sphere_is_itself(room):
    sphere = room.sphere(SE3.identity(), SPHERE)
    view = synthesize([PlacedSurface(surface_of(sphere), SE3.identity())], SE3.identity(), SPHERE)
    assert view.is_known.mean() > 0.999
    rows = slice(40, 216)  # poles are drawn apart, by the nearest pixel
    error = np.abs(view.image[rows, :, 0].astype(int) - sphere.image[rows])
    assert np.quantile(error, 0.999) <= 2
    assert error.max() <= 8


def test_no_sheet_is_drawn_between_a_board_and_the_wall_behind(room_with_board):
    first = placed(room_with_board)[:1]
    T = optical(SE3.from_planar(0.0, 0.8, 0.0))
    view = synthesize(first, T, PINHOLE)
    _, range_m = room_with_board.render(PINHOLE, T)
    is_board = range_m < 2.6
    shadow = ~view.is_known
    assert 0.02 < shadow.mean() < 0.25  # what the board hid is a hole, marked
    assert not is_board[shadow].mean() > 0.2
    error = np.abs(view.range_m / range_m - 1)[view.is_known]
    assert np.mean(error > 0.05) < 0.02  # a sheet would lie between the ranges of board and wall
    assert (view.image[shadow] == 0).all()
    assert (view.image[view.is_known] > 0).all()


def test_a_second_sphere_fills_what_the_first_did_not_see(room_with_board):
    T = optical(SE3.from_planar(0.2, 0.8, 0.0))
    T_other = SE3.from_planar(0.4, 1.2, 0.0)
    first = placed(room_with_board)[0]
    other = PlacedSurface(surface_of(room_with_board.sphere(T_other, SPHERE)), T_other, 0.0)
    alone, both = synthesize([first], T, PINHOLE), synthesize([first, other], T, PINHOLE)
    assert both.is_known.mean() > 0.99 > alone.is_known.mean()
    gray, _ = room_with_board.render(PINHOLE, T)
    assert psnr(both, gray) > 22  # edges of the board: one pixel of a sphere is two of the view


def test_weights_fall_with_the_distance_to_none_at_the_one_left_out():
    assert blend_weights([1.0, 2.0, 4.0]).tolist() == [0.75, 0.25]  # (1 - 1/4) / 1 and (1 - 2/4) / 2
    assert blend_weights([0.5, 1.0, 2.0]).tolist() == [0.75, 0.25]
    np.testing.assert_allclose(blend_weights([0.0, 1.0, 2.0]), [500 / 500.5, 0.5 / 500.5])  # 0 counts as 2 mm
    assert blend_weights([0.0, 0.0]).tolist() == [1.0]


def ball(range_m, gray, weight):
    shape = (SPHERE.height, SPHERE.width)
    sphere = Sphere(np.full(shape, gray, np.uint8), np.full(shape, range_m, np.float32), SPHERE)
    return PlacedSurface(surface_of(sphere), SE3.identity(), weight)


def test_what_agrees_is_blended_and_the_nearer_hides_the_rest():
    for range_m, other_m, weights, gray in [
        (2.0, 2.0 / 0.96, (0.5, 0.5), 150),  # within 5 % of nearness one surface
        (2.0, 2.0 / 0.94, (0.5, 0.5), 100),  # else the nearer hides the other
        (2.0 / 0.94, 2.0, (0.5, 0.5), 200),
        (100.0, 180.0, (0.5, 0.5), 150),  # by 0.0045 1/m
        (100.0, 250.0, (0.5, 0.5), 100),  # by 0.006 1/m
        (2.0, 2.0, (0.8, 0.2), 120),
        (2.0, 2.0, (1.0, 0.0), 100),
        (2.0 / 0.94, 2.0, (1.0, 0.0), 200),  # what one alone saw is never left out
    ]:
        pair = [ball(range_m, 100, weights[0]), ball(other_m, 200, weights[1])]
        view = synthesize(pair, SE3.identity(), PINHOLE)
        assert view.is_known.all()
        np.testing.assert_array_equal(view.image, gray)
        np.testing.assert_allclose(view.range_m, min(range_m, other_m), rtol=0.01)


def test_poles_look_where_they_are():
    """Grey levels that say where a pixel is: a picture that is turned, mirrored or bent around a pole would show."""
    rays = SPHERE.unproject(np.stack(np.meshgrid(np.arange(512.0), np.arange(256.0)), axis=-1))
    image = np.rint(128 + 60 * rays[..., 0] + 40 * rays[..., 1]).astype(np.uint8)
    sphere = Sphere(image, np.full((256, 512), 3.0, np.float32), SPHERE)
    view = synthesize([PlacedSurface(surface_of(sphere), SE3.identity())], SE3.identity(), SPHERE)
    for rows in (slice(0, 30), slice(226, 256)):
        is_known = view.is_known[rows]
        assert is_known.mean() > 0.99
        assert np.abs(view.image[rows, :, 0].astype(int) - image[rows])[is_known].max() <= 3  # nearest pixel of 12 mrad
        np.testing.assert_allclose(view.range_m[rows][is_known], 3.0, rtol=5e-3)


def test_far_is_far_and_a_hole_is_none():
    view = synthesize([ball(np.inf, 100, 1.0)], SE3.identity(), PINHOLE)
    assert np.isposinf(view.range_m).all()
    assert view.is_known.all()
    view = synthesize([ball(np.nan, 100, 1.0)], SE3.identity(), PINHOLE)
    assert np.isnan(view.range_m).all()
    assert not view.is_known.any()
    assert not view.image.any()


def test_colors_are_read_between_pixels_and_around_a_whole_sphere(rng):
    for camera in (Spherical(16, 8), Spherical(12, 6, 64.0)):
        image = rng.integers(1, 255, (camera.height, camera.width, 3), dtype=np.uint8)
        surface = surface_of(Sphere(image, np.ones(image.shape[:2], np.float32), camera))
        last = camera.width - (0.1 if camera.is_whole else 1.0)
        u, v = rng.uniform(0, last, (5, 7)), rng.uniform(0, camera.height - 1.0, (5, 7))
        found = _colors_at(surface, np.stack([u, v], axis=-1).astype(np.float32))
        iu, iv = np.floor(u).astype(int), np.floor(v).astype(int)
        du, dv, picture = (u - iu)[..., None], (v - iv)[..., None], image.astype(float)
        upper, lower = (
            (1 - du) * picture[row, iu] + du * picture[row, (iu + 1) % camera.width] for row in (iv, iv + 1)
        )
        # OpenCV reads at steps of 1/32 px
        np.testing.assert_allclose(found, (1 - dv) * upper + dv * lower, atol=2 * 255 / 64 + 1)


def test_every_kernel_is_compiled_before_the_first_view():
    warm_up()
    assert all(kernel.signatures for kernel in (kernels.project_corners, kernels.draw_quads))
