"""Rows of a rolling shutter are where the camera was when they were read."""

import numpy as np
import pytest

from sphere_nav.geometry import SE3, Fisheye, FrameMotion, Pinhole
from sphere_nav.geometry.cameras.rolling_shutter import project_rolling, row_share

CAMERAS = [
    Pinhole(320, 240, 260.0, 262.0, 158.0, 121.0, (-0.1, 0.02)),
    Fisheye(320, 240, 110.0, 110.5, 158.0, 121.0, (0.02, -0.01, 0.0, 0.0)),
]
TWIST = np.array([0.03, -0.02, 0.05, 0.02, -0.03, 0.01])


@pytest.mark.parametrize("camera", CAMERAS, ids=["pinhole", "fisheye"])
def test_a_pixel_is_what_the_camera_of_its_row_sees(camera, rng):
    pixels = rng.uniform((20, 20), (300, 220), (200, 2))
    rays = camera.unproject(pixels) * rng.uniform(0.8, 10.0, (200, 1))
    T_middle_row = SE3.exp(row_share(pixels[:, 1], camera.height)[:, None] * TWIST)
    points = np.einsum("nij,nj->ni", T_middle_row.rotation, rays) + T_middle_row.translation
    found, visible = project_rolling(camera, points, TWIST)
    assert np.abs(found - pixels).max() < 1e-6
    assert visible.all()


def test_the_rows_of_a_frame_are_half_a_readout_before_and_after_the_middle():
    share = row_share([-0.5, 119.5, 239.5], 240)
    assert share == pytest.approx([-0.5, 0.0, 0.5])


def test_the_motion_within_a_frame_is_a_share_of_that_since_the_one_before():
    before = SE3.exp([1.0, 2.0, 0.5, 0.3, -0.2, 0.1])
    moved = np.array([0.1, 0.0, 0.02, 0.01, 0.02, -0.03])
    assert FrameMotion(before, 0.68).twist(before @ SE3.exp(moved)) == pytest.approx(0.68 * moved)
