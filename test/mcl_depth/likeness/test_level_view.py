"""Photographs of leaning cameras in the level panorama."""

from __future__ import annotations

import numpy as np

from mcl_depth.geometry.synthesis import panorama_window
from mcl_depth.image_params import SynthesisParams
from mcl_depth.likeness.level_view import level_view
from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.geometry.cameras.camera import pixel_grid

WINDOW = panorama_window(SynthesisParams(num_columns=90))
T_BODY_OPTICAL = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])


def world(rays: np.ndarray) -> np.ndarray:
    return (127 + 60 * rays[..., 0] + 40 * rays[..., 1] * rays[..., 2]).astype(np.float32)


def test_a_leaning_sphere_looks_like_a_level_one() -> None:
    camera = Spherical(360, 180)
    lean = SE3.exp([0.0, 0, 0, 0.2, -0.15, 0.0]).rotation
    image = world(camera.unproject(pixel_grid(camera)) @ lean.T)
    grey, is_seen = level_view(image, camera, lean, WINDOW)
    assert is_seen.all()
    np.testing.assert_allclose(grey, world(WINDOW.unproject(pixel_grid(WINDOW))), atol=0.5)  # smoothing of a pixel


def test_a_pinhole_sees_its_part() -> None:
    camera = Pinhole(160, 120, 80.0, 80.0, 79.5, 59.5)
    image = world(camera.unproject(pixel_grid(camera)) @ T_BODY_OPTICAL.T)
    grey, is_seen = level_view(image, camera, T_BODY_OPTICAL, WINDOW)
    assert 0.2 < is_seen[len(grey) // 2].mean() < 0.3  # 90 of 360 degrees
    expected = world(WINDOW.unproject(pixel_grid(WINDOW)))
    np.testing.assert_allclose(grey[is_seen], expected[is_seen], atol=0.5)
