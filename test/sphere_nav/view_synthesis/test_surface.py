"""What a sphere saw, as quads."""

import numpy as np

from sphere_nav.geometry import SE3, Spherical
from sphere_nav.spheres.sphere import Sphere
from sphere_nav.view_synthesis.surface import _quads, find_breaks, surface_of

CAMERA = Spherical(128, 64)


def test_corners_lie_where_the_sphere_measured(room):
    sphere = room.sphere(SE3.identity(), CAMERA)
    surface = surface_of(sphere)
    v, u = np.rint(surface.pixels.T).astype(int).clip(0, 63 + 64 * np.array([[0], [1]]))
    assert np.allclose(np.linalg.norm(surface.points, axis=0), sphere.range_m[v, u], rtol=1e-3)
    pixels, _ = CAMERA.project(surface.points.T)
    is_pole = (surface.pixels[:, 0] < 0) | (surface.pixels[:, 0] > 63)
    assert np.allclose(pixels[~is_pole], np.stack([u, v], axis=1)[~is_pole], atol=1e-3)
    assert np.allclose(pixels[is_pole, 1], surface.pixels[is_pole, 0], atol=1e-2)
    assert surface.corners.max() == surface.points.shape[1] - 1
    assert surface.num_bytes > surface.image.nbytes


def test_unknown_pixels_are_in_no_quad_and_the_sky_is_far():
    range_m = np.full((64, 128), 5.0, np.float32)
    range_m[:20], range_m[30:40, 50:60] = np.inf, np.nan
    surface = surface_of(Sphere(np.full((64, 128), 7, np.uint8), range_m, CAMERA))
    v, u = surface.pixels.T.astype(int)
    assert not np.isnan(surface.points).any()
    assert not np.isnan(range_m[v, u]).any()
    assert np.linalg.norm(surface.points, axis=0).max() > 1e5
    rows = surface.pixels[surface.corners, 0]
    assert not ((rows.min(axis=1) < 20) & (rows.max(axis=1) >= 20)).any()  # no sheet from the sky to the wall
    assert surface.image.shape == (64, 128, 3)


def test_a_step_is_a_break_a_slope_or_a_crease_is_none_and_a_thin_thing_has_two():
    row = np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5, 0.45, 0.40, 0.35, 0.30])
    crease, thin = [0.5, 0.5, 0.5, 0.45, 0.38, 0.31, 0.24], [0.5, 0.5, 0.5, 1.0, 0.5, 0.5, 0.5]
    for nearness, places in [(row, [2]), (crease, []), (thin, [2, 3])]:
        picture = np.tile(np.array(nearness, np.float32), (3, 1))
        for found in (find_breaks(picture, 1, "edge"), find_breaks(picture.T, 0, "edge").T):
            assert np.flatnonzero(found[1]).tolist() == places
        assert not find_breaks(picture, 0, "edge").any()
    assert np.flatnonzero(find_breaks(np.tile(row, (3, 1)), 1, "wrap")[1]).tolist() == [2, 9]


def test_quads_cover_what_has_no_break_once(rng):
    for camera in (Spherical(512, 256), Spherical(511, 256, 512.0)):
        nearness = np.full((camera.height, camera.width), 0.5, np.float32)
        nearness[50:90, 100:140] = 1.0
        nearness[rng.random(nearness.shape) < 0.02] = np.nan
        quads, covered = _quads(nearness, camera), np.zeros(nearness.shape, int)
        for v, u, size in quads:
            assert u + size <= camera.width - (not camera.is_whole)
            covered[v : v + size, u : u + size] += 1
        right = np.roll(nearness, -1, axis=1)
        corners = np.stack([nearness[:-1], right[:-1], nearness[1:], right[1:]])
        expected = np.ptp(corners, axis=0) == 0  # false for NaN
        columns = slice(camera.width - (not camera.is_whole))
        np.testing.assert_array_equal(covered[:-1, columns], expected[:, columns])
        assert set(quads[:, 2]) == {1, 2}


def test_a_plane_makes_large_quads_and_waves_small_ones():
    v, u = np.mgrid[0:513, 0:1025] / 1000.0
    camera = Spherical(1025, 513, 1026.0)
    for nearness, size in [(0.5 + 0.1 * u + 0.2 * v, 4), (0.5 + 0.01 * np.sin(1000 * (u + v)), 1)]:
        assert set(_quads(nearness.astype(np.float32), camera)[:, 2]) == {size}


def surface_of_nearness(nearness):
    height, width = nearness.shape
    image = np.full((height, width), 50, np.uint8)
    return surface_of(Sphere(image, (1.0 / nearness).astype(np.float32), Spherical(width, height)))


def sides(surface):
    """Columns that each quad without a pole spans, and its left one."""
    pixels = surface.pixels[surface.corners]
    within = np.all((pixels[..., 0] >= 0) & (pixels[..., 0] <= surface.camera.height - 1), axis=1)
    left, right = pixels[within, 0, 1], pixels[within, 1, 1]
    return np.where(right < left, right + surface.camera.width, right) - left, left


def test_a_step_of_three_per_cent_or_of_the_floor_ends_a_surface():
    floor = [(0.05, 0.0035 / 0.05, False), (0.05, 0.0045 / 0.05, True)]
    for near, change, is_cut in [(0.5, 0.025, False), (0.5, 0.035, True), *floor]:
        nearness = np.full((64, 128), near)
        nearness[:, 64:96] *= 1 - change
        width, left = sides(surface_of_nearness(nearness))
        across = (left <= 63) & (left + width >= 64)
        assert across.any() != is_cut


def test_large_quads_are_flat_within_three_per_mille_or_the_floor():
    for near, change, size in [(0.5, 0.002 * 0.5, 2), (0.5, 0.004 * 0.5, 1), (0.05, 4e-4, 2), (0.05, 6e-4, 1)]:
        nearness = np.full((256, 512), near)
        nearness[:, 201] += change  # the middle of a quad of two
        width, left = sides(surface_of_nearness(nearness))
        assert width[(left >= 200) & (left <= 201)].max() == size


def test_the_largest_quads_are_a_256th_of_a_turn():
    for width, largest in [(128, 1), (256, 1), (512, 2), (1024, 4)]:
        assert sides(surface_of_nearness(np.full((width // 2, width), 0.5)))[0].max() == largest
