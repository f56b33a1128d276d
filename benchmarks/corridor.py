"""A corridor without end whose walls repeat, drawn in closed form: images and range of a walk past many key spheres."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.room import hit_walls
from sphere_nav.geometry import SE3, Camera

SPACING_M = 1000.0 / 300.0  # after which the walls repeat
HALF_SIDES_M = np.array([np.inf, 2.5, 2.0])
SIGHT_M = 25.0  # beyond it is haze, known to be far
NUM_WAVES = 24


def render(camera: Camera, T_corridor_camera: SE3, seed: int = 0) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return the grey image (H, W) and the range along the ray (H, W) in metres; the corridor runs along x."""
    rays, range_m = hit_walls(camera, T_corridor_camera, HALF_SIDES_M)
    points = T_corridor_camera.translation + rays * np.minimum(range_m, SIGHT_M)[..., None]
    return _gray(points, range_m, np.random.default_rng(seed)), np.where(range_m > SIGHT_M, np.inf, range_m).astype(
        np.float32
    )


def _gray(points: NDArray[np.float64], range_m: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return the sum of waves that have a whole number of periods from one key sphere to the next."""
    gray = np.zeros(points.shape[:-1])
    for frequency in np.geomspace(1.5, 40.0, NUM_WAVES):  # radians per metre
        direction = rng.normal(size=3)
        wave = frequency * direction / np.linalg.norm(direction)
        wave[0] = 2.0 * np.pi / SPACING_M * np.rint(wave[0] * SPACING_M / (2.0 * np.pi))
        gray += 30.0 / np.sqrt(frequency) * np.sin(points @ wave + rng.uniform(0.0, 2.0 * np.pi))
    return np.clip(np.rint(128.0 + np.where(range_m > SIGHT_M, 0.0, gray)), 1, 255).astype(np.uint8)
