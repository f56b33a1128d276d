"""Corners of a drive along walls at a slant are followed without being shortened; bare images have none."""

import numpy as np
import pytest

from sphere_mapping.acquisition.stereo.corner_tracks import (
    OFFSETS,
    cut_patches,
    find_patches,
    follow_shifted,
    follow_window,
    spline_of,
    warps_of,
)
from sphere_mapping.acquisition.stereo.stereo_field import corners_of
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.cameras.camera import pixel_grid
from worlds.room import optical, sharp_room

CAMERA = Pinhole(320, 240, 200.0, 200.0, 159.5, 119.5)
BASELINE, STEP_M, NUM_VIEWS = 0.3, 0.3, 3
HALL = sharp_room((6, 3, 2), shortest=0.15)
T_HALL_VIEW = [optical(SE3.exp([-3.0 + STEP_M * k, 0.3, 0.1, 0.0, 0.0, 0.0])) for k in range(NUM_VIEWS)]


@pytest.fixture(scope="module")
def images():
    T_left_right = SE3.exp([BASELINE, 0, 0, 0, 0, 0])
    return [[HALL.photograph(CAMERA, T @ side, k, 1.5) for k, T in enumerate(T_HALL_VIEW)]
            for side in (SE3.identity(), T_left_right)]  # fmt: skip


def errors(window):
    """Return by how much each track is off (N, 3) in the last view: left u, v and right u."""
    rays = np.column_stack([(window.left[0] - (CAMERA.cx, CAMERA.cy)) / CAMERA.fx, np.ones(len(window.left[0]))])
    rays = rays / np.linalg.norm(rays, axis=1, keepdims=True) @ T_HALL_VIEW[0].rotation.T
    points = T_HALL_VIEW[0].translation + rays * HALL.cast(T_HALL_VIEW[0].translation, rays)[1][:, None]
    at = T_HALL_VIEW[-1].inverse().apply(points)
    left, _ = CAMERA.project(at)
    right, _ = CAMERA.project(at - (BASELINE, 0, 0))
    return np.column_stack([window.left[-1] - left, window.right_u[-1] - right[:, 0]])


def test_tracks_are_where_their_points_went(images):
    window, shifted = follow_window(CAMERA, BASELINE, *images), follow_shifted(*images)
    good, rough = errors(window), errors(shifted)
    assert np.count_nonzero(np.isfinite(good).all(axis=1)) > 200
    assert np.nanmedian(np.abs(good)) < 0.6 * np.nanmedian(np.abs(rough))
    outwards = np.sign(window.left[0] - (CAMERA.cx, CAMERA.cy))  # what a shortened flow lacks
    assert abs(np.nanmedian(good[:, :2] * outwards)) < 0.005


LONG_LENS = Pinhole(320, 240, 250.0, 250.0, 159.5, 119.5)
PLANE = np.array([0.25, 0.1, 0.3])  # inverse depth of a ray (x, y, 1)
FLAT = (np.broadcast_to(OFFSETS, (60, *OFFSETS.shape)), np.broadcast_to(np.eye(2), (60, 2, 2)))
ROUGH_HALL = sharp_room(shortest=0.2)


def render(T, gain=1.0):
    rays = np.concatenate(
        [(pixel_grid(LONG_LENS) - (LONG_LENS.cx, LONG_LENS.cy)) / LONG_LENS.fx, np.ones((240, 320, 1))], axis=-1
    )
    R, t = T.inverse().rotation, T.inverse().translation
    depth = (1 - t @ PLANE) / (rays @ R.T @ PLANE)
    gray = ROUGH_HALL.gray((rays @ R.T) * depth[..., None] + t)
    return np.clip(np.rint(gain * gray + np.random.default_rng(1).normal(0, 1, gray.shape)), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def points():
    corners = corners_of(render(SE3.identity()))
    return corners[np.all((corners > (60, 50)) & (corners < (260, 190)), axis=1)][:60]


def image_of(points, T):
    rays = np.column_stack([(points - (LONG_LENS.cx, LONG_LENS.cy)) / LONG_LENS.fx, np.ones(len(points))])
    return LONG_LENS.project(T.apply(rays / (rays @ PLANE)[:, None]))[0]


def test_a_plane_is_found_where_it_went(points):
    T = SE3.exp([0.1, -0.05, -0.6, 0.01, 0.02, -0.01])
    rays = np.column_stack([(points - (LONG_LENS.cx, LONG_LENS.cy)) / LONG_LENS.fx, np.ones(len(points))])
    slopes = np.broadcast_to(PLANE[:2] / LONG_LENS.fx, (len(points), 2))
    warps, derivative = warps_of(LONG_LENS, points, rays @ PLANE, slopes, T)
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
    expected = -LONG_LENS.fx * 0.3 * PLANE[:2] / LONG_LENS.fx  # disparity is f b times the inverse depth
    np.testing.assert_allclose(np.median(slopes[is_found], axis=0), expected, atol=0.005)
    assert np.abs((found - true)[is_found].mean(axis=0)).max() < 0.02  # 0.05 px each, some 60 of them
