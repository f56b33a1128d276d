"""Photographs of leaning cameras in the level panorama."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mcl_depth.geometry.synthesis import panorama_window
from mcl_depth.likeness.level_view import level_view
from mcl_depth.params import SynthesisParams
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
    gray, is_seen = level_view(image, camera, lean, WINDOW)
    assert is_seen.all()
    np.testing.assert_allclose(gray, world(WINDOW.unproject(pixel_grid(WINDOW))), atol=0.5)  # smoothing of a pixel


def test_a_pinhole_sees_its_part() -> None:
    camera = Pinhole(160, 120, 80.0, 80.0, 79.5, 59.5)
    image = world(camera.unproject(pixel_grid(camera)) @ T_BODY_OPTICAL.T)
    gray, is_seen = level_view(image, camera, T_BODY_OPTICAL, WINDOW)
    assert 0.2 < is_seen[len(gray) // 2].mean() < 0.3  # 90 of 360 degrees
    expected = world(WINDOW.unproject(pixel_grid(WINDOW)))
    np.testing.assert_allclose(gray[is_seen], expected[is_seen], atol=0.5)


def noise(camera: Pinhole | Spherical) -> np.ndarray:
    return np.random.default_rng(0).uniform(0, 255, (camera.height, camera.width)).astype(np.float32)


@pytest.mark.parametrize(("focal", "size", "is_halved"), [(30.0, 64, True), (28.0, 64, False)])
def test_photographs_more_than_twice_as_fine_are_averaged_first(focal, size, is_halved) -> None:
    """The panorama has 90 / 2 pi = 14.3 pixels a radian."""
    camera = Pinhole(64, size, focal, focal, 31.5, 31.5)
    image = noise(camera)
    found, is_seen = level_view(image, camera, T_BODY_OPTICAL, WINDOW)
    if size % 2 == 0:
        small = cv2.resize(image, (32, size // 2), interpolation=cv2.INTER_AREA)
        halved, is_seen_halved = level_view(small, camera.halve(), T_BODY_OPTICAL, WINDOW)
        assert (np.array_equal(found, halved) and np.array_equal(is_seen, is_seen_halved)) == is_halved
    assert is_seen.any()
