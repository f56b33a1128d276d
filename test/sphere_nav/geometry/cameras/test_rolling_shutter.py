"""Rows of a rolling shutter are where the camera was when they were read."""

import numpy as np
import pytest

from sphere_nav.geometry import SE3, Fisheye, FrameMotion, Omni, Pinhole
from sphere_nav.geometry.cameras.lens import camera_of, first_lens, lens_of
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


def test_rows_are_half_a_readout_before_and_after_the_middle_by_a_share_of_the_motion_since_the_frame_before():
    share = row_share([-0.5, 119.5, 239.5], 240)
    assert share == pytest.approx([-0.5, 0.0, 0.5])
    before = SE3.exp([1.0, 2.0, 0.5, 0.3, -0.2, 0.1])
    moved = np.array([0.1, 0.0, 0.02, 0.01, 0.02, -0.03])
    assert FrameMotion(before, 0.68).twist(before @ SE3.exp(moved)) == pytest.approx(0.68 * moved)


LENSES = (
    Pinhole(640, 480, 400.0, 402.0, 318.0, 243.0, (-0.2, 0.05, 1e-3, -5e-4, -0.01)),
    Fisheye(640, 480, 250.0, 251.0, 321.0, 238.0, (0.03, -0.012, 0.004, -0.0006)),
    Omni(640, 480, 500.0, 501.0, 321.0, 238.0, 1.3, (-0.12, 0.06, 2e-3, -3e-3)),
)


@pytest.mark.parametrize("camera", LENSES, ids=lambda camera: camera.model)
def test_a_lens_is_the_camera_and_starts_with_its_resolution(camera):
    assert camera_of(camera.model, (640, 480), lens_of(camera), 5) == camera
    start = camera_of(camera.model, (640, 480), first_lens(camera.model, 300.0, (321.0, 238.0)), 0)
    radius = {"pinhole": np.tan(0.8), "omni": 2.0 * np.tan(0.4)}.get(camera.model, 0.8)
    found, _ = start.project([np.sin(0.8), 0.0, np.cos(0.8)])
    np.testing.assert_allclose(found, [321.0 + 300.0 * radius, 238.0], rtol=2e-3)
