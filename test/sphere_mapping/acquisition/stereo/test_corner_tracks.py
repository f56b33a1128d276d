"""Corners of a drive along walls at a slant are followed without being shortened; bare images have none."""

import numpy as np
import pytest

from sphere_mapping.acquisition.stereo.corner_tracks import follow_shifted, follow_window
from sphere_nav.geometry import SE3, Pinhole
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
