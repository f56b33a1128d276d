"""Prepared references hold points, grey levels and gradients by the point; which pixels a camera is compared with."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.photometric import PyramidParams, RegistrationParams, build_pyramid, prepare_reference
from sphere_nav.photometric.pixels.reference import choose_pixels, curve, holds, prepare_level, select
from sphere_nav.spheres.sphere import T_BODY_OPTICAL

CAMERA = Pinhole(80, 60, 55.0, 55.0, 39.5, 29.5)
PARAMS = RegistrationParams(pyramid=PyramidParams(num_levels=2, min_side=8))


def test_points_lie_where_the_room_is_with_the_gradient_of_the_image_by_the_point(room):
    image, range_m = room.render(CAMERA, T_BODY_OPTICAL)
    level = prepare_reference(image, range_m, CAMERA, PARAMS).levels[0]
    points = T_BODY_OPTICAL.apply(level.points.T)
    assert level.num_pixels == 58 * 78
    assert np.abs(room.gray(points) - level.intensity).max() < 0.5  # ranges are kept within 0.017 %
    gy, gx = np.gradient(image.astype(np.float64))
    pixels = np.round(CAMERA.project(level.points.T)[0]).astype(int)
    g = np.stack([gx[pixels[:, 1], pixels[:, 0]], gy[pixels[:, 1], pixels[:, 0]]], axis=-1)
    expected = np.einsum("ni,nij->nj", g, CAMERA.J_project(level.points.T))
    assert np.abs(level.gradient.T - expected).max() < 1e-3 * np.abs(expected).max()


def test_the_gradient_of_a_whole_sphere_has_no_seam(room):
    camera = Spherical(128, 64)
    image, range_m = room.render(camera, SE3.identity())

    def prepare(image, range_m):
        return prepare_level(build_pyramid(image, camera, PARAMS.pyramid).levels[0], range_m, PARAMS.far)

    level = prepare(image, range_m)
    assert level.num_pixels == 62 * 128  # every column, the first and last row left out
    turned = prepare(np.roll(image, 64, axis=1), np.roll(range_m, 64, axis=1))
    row, column = np.mgrid[0:64, 0:128]
    place = np.argsort(curve(128, 64))[row // 16 * 8 + column // 16]
    order = np.argsort(place[1:-1].reshape(-1), kind="stable")  # square by square
    scan = np.argsort(order)
    norm = np.linalg.norm(level.gradient, axis=0)[scan].reshape(62, 128)
    norm_turned = np.linalg.norm(turned.gradient, axis=0)[scan].reshape(62, 128)
    assert np.allclose(np.roll(norm, 64, axis=1), norm_turned, rtol=1e-3, atol=1e-2)


def test_unknown_range_is_left_out_far_is_far_and_what_is_not_positive_refused(room):
    image, range_m = room.render(CAMERA, T_BODY_OPTICAL)
    range_m[:30] = np.nan
    range_m[30:40] = np.inf
    level = prepare_reference(image, range_m, CAMERA, PARAMS).levels[0]
    distance = np.linalg.norm(level.points, axis=0)
    assert level.num_pixels == 27 * 78  # two rows of the far are behind the edge of the room
    assert np.sum(np.isclose(distance, PARAMS.far, rtol=1e-4)) == 8 * 78
    assert np.isfinite(level.gradient).all()
    for bad in [0.0, -1.0]:
        image, range_m = room.render(CAMERA, T_BODY_OPTICAL)
        range_m[3, 4] = bad
        with pytest.raises(ValueError, match="range: expected positive"):
            prepare_reference(image, range_m, CAMERA, PARAMS)
    with pytest.raises(ValueError, match=r"range: expected 80 x 60, found shape \(59, 80\)"):
        prepare_reference(image, range_m[1:], CAMERA, PARAMS)


def test_what_is_behind_the_edge_of_a_nearer_surface_is_left_out():
    """Not the edge itself, nor a steep floor and the foot of a wall, nor what is beside unknown ranges."""
    v, u = np.mgrid[0:60, 0:80]
    inverse = 0.1 + 0.02 * abs(v - 10.0)  # up to 20 % from row to row
    is_near = (abs(u - 40) < 10) & (abs(v - 30) < 6)
    inverse[is_near] = 3.0
    inverse[:, 10:14] = np.nan
    z_of_ray = pixel_rays(CAMERA)[..., 2]
    range_m = (1.0 / (inverse * z_of_ray)).astype(np.float32)
    level = prepare_reference(np.zeros((60, 80), np.uint8), range_m, CAMERA, PARAMS).levels[0]
    kept = np.zeros((60, 80), np.bool_)
    column, row = np.rint(CAMERA.project(level.points.T)[0]).astype(int).T
    kept[row, column] = True
    expected = np.isfinite(inverse)
    expected[[0, -1]], expected[:, [0, -1]] = False, False  # without a gradient
    for off in (1, 2):
        for axis in (0, 1):
            expected &= is_near | ~(np.roll(is_near, off, axis) | np.roll(is_near, -off, axis))
    np.testing.assert_array_equal(kept, expected)


def test_any_piece_of_the_curve_is_a_patch():
    order = curve(512, 256)
    assert sorted(order.tolist()) == list(range(32 * 16))
    for first in range(0, 512, 16):
        row, column = order[first : first + 16] // 32, order[first : first + 16] % 32
        assert np.ptp(row) < 4
        assert np.ptp(column) < 4


WIDER = Pinhole(160, 120, 110.0, 110.0, 79.5, 59.5)
SPHERE = Spherical(1024, 512)
T_CAMERA_BODY = SE3.from_parts([[0, -1, 0], [0, 0, -1], [1, 0, 0]], [0, 0, 0])
A = SE3.from_planar(0.5, -0.4, 0.3)


@pytest.fixture(scope="module")
def reference(room):
    image, range_m = room.render(SPHERE, A)
    return prepare_reference(image, range_m, SPHERE)


@pytest.fixture(scope="module")
def levels():
    return build_pyramid(np.zeros((120, 160), np.uint8), WIDER).levels


def test_the_reference_level_matches_the_resolution_of_the_image(reference, levels):
    assert reference.level_like(levels[0].camera).camera.width == 512  # 163 px/rad halved once is nearest to 110
    assert reference.level_like(levels[1].camera).camera.width == 256


def test_only_what_is_seen_is_made(room):
    image, range_m = room.render(SPHERE, A)
    made = prepare_reference(image, range_m, SPHERE)
    empty = made.num_bytes
    select(made.levels[1], T_CAMERA_BODY, WIDER, 500)
    some = made.num_bytes
    assert empty < some
    for level in made.levels:
        level.all()
    assert some - empty < 0.2 * (made.num_bytes - empty)


def test_a_selection_holds_for_a_tenth_of_the_width(reference):
    pixels = reference.levels[1]
    first = choose_pixels(pixels, T_CAMERA_BODY, WIDER, 400)

    def turned(share):
        """Return the pose after a turn that moves the image by a share of its width."""
        return SE3.exp([0, 0, 0, 0, share * WIDER.width / WIDER.fx, 0]) @ T_CAMERA_BODY

    assert choose_pixels(pixels, turned(0.098), WIDER, 400) is first
    assert not holds(pixels, turned(0.098), WIDER, 400, 0.05)
    assert choose_pixels(pixels, turned(0.102), WIDER, 400) is not first
    chosen = sum(one.blocks.nbytes for one in pixels.selections.values())
    with_them = pixels.num_bytes
    pixels.selections.clear()
    assert with_them - pixels.num_bytes == chosen >= first.blocks.nbytes


@pytest.mark.slow
def test_threads_see_the_same_squares(room):
    reference = prepare_reference(*room.render(SPHERE, A), SPHERE)
    turns = [SE3.exp([0, 0, 0, 0, 0.1 * k, 0]) @ T_CAMERA_BODY for k in range(60)]
    with ThreadPoolExecutor(4) as threads:
        found = list(threads.map(lambda T: select(reference.levels[0], T, WIDER, 500), turns))
    alone = prepare_reference(*room.render(SPHERE, A), SPHERE)
    for T, one in zip(turns, found, strict=True):
        assert np.array_equal(one.blocks, select(alone.levels[0], T, WIDER, 500).blocks, equal_nan=True)
