"""Patches of a slanted plane are found to a few thousandths of a pixel, whatever the light; bare ones are not."""

import numpy as np
import pytest

from sphere_mapping.acquisition.stereo.corner_tracks import OFFSETS, cut_patches, find_patches, spline_of, warps_of
from sphere_mapping.acquisition.stereo.stereo_field import corners_of
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.cameras.camera import pixel_grid
from worlds.room import sharp_room

CAMERA = Pinhole(320, 240, 250.0, 250.0, 159.5, 119.5)
PLANE = np.array([0.25, 0.1, 0.3])  # inverse depth of a ray (x, y, 1)
FLAT = (np.broadcast_to(OFFSETS, (60, *OFFSETS.shape)), np.broadcast_to(np.eye(2), (60, 2, 2)))
HALL = sharp_room(shortest=0.2)


def render(T, gain=1.0):
    rays = np.concatenate([(pixel_grid(CAMERA) - (CAMERA.cx, CAMERA.cy)) / CAMERA.fx, np.ones((240, 320, 1))], axis=-1)
    R, t = T.inverse().rotation, T.inverse().translation
    depth = (1 - t @ PLANE) / (rays @ R.T @ PLANE)
    gray = HALL.gray((rays @ R.T) * depth[..., None] + t)
    return np.clip(np.rint(gain * gray + np.random.default_rng(1).normal(0, 1, gray.shape)), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def points():
    corners = corners_of(render(SE3.identity()))
    return corners[np.all((corners > (60, 50)) & (corners < (260, 190)), axis=1)][:60]


def image_of(points, T):
    rays = np.column_stack([(points - (CAMERA.cx, CAMERA.cy)) / CAMERA.fx, np.ones(len(points))])
    return CAMERA.project(T.apply(rays / (rays @ PLANE)[:, None]))[0]


def test_a_plane_is_found_where_it_went(points):
    T = SE3.exp([0.1, -0.05, -0.6, 0.01, 0.02, -0.01])
    rays = np.column_stack([(points - (CAMERA.cx, CAMERA.cy)) / CAMERA.fx, np.ones(len(points))])
    slopes = np.broadcast_to(PLANE[:2] / CAMERA.fx, (len(points), 2))
    warps, derivative = warps_of(CAMERA, points, rays @ PLANE, slopes, T)
    true = image_of(points, T)
    around = image_of((points[:, None] + OFFSETS).reshape(-1, 2), T).reshape(warps.shape)
    np.testing.assert_allclose(true[:, None] + warps, around, atol=1e-9)
    step = 1e-4
    for n, along in enumerate(np.eye(2)):
        moved = (image_of(points + step * along, T) - image_of(points - step * along, T)) / (2 * step)
        np.testing.assert_allclose(derivative[..., n], moved, atol=1e-6)
    patches = cut_patches(spline_of(render(SE3.identity())), points)
    other, start = spline_of(render(T, gain=0.8)), true + np.array([0.4, -0.3])
    found, _, is_found = find_patches(patches, other, start, warps, derivative, is_slanted=False)
    off, shifted = (one - true for one in (found, find_patches(patches, other, start, *FLAT, is_slanted=False)[0]))
    assert is_found.mean() > 0.9
    assert np.abs(off[is_found].mean(axis=0)).max() < 0.02  # 0.05 px each, some 60 of them
    assert np.median(np.linalg.norm(off, axis=1)) < 0.5 * np.median(np.linalg.norm(shifted, axis=1))


def test_the_slope_of_the_disparity_is_found(points):
    T = SE3.exp([-0.3, 0, 0, 0, 0, 0])
    true = image_of(points, T)
    patches = cut_patches(spline_of(render(SE3.identity())), points)
    found, slopes, is_found = find_patches(patches, spline_of(render(T)), true + 0.2, *FLAT, is_slanted=True)
    assert is_found.mean() > 0.9
    expected = -CAMERA.fx * 0.3 * PLANE[:2] / CAMERA.fx  # disparity is f b times the inverse depth
    np.testing.assert_allclose(np.median(slopes[is_found], axis=0), expected, atol=0.005)
    assert np.abs((found - true)[is_found].mean(axis=0)).max() < 0.02  # 0.05 px each, some 60 of them
