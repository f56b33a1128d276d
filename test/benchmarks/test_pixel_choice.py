"""What the benchmark of pixel choice computes by itself."""

import numpy as np

from benchmarks import pixel_choice
from sphere_nav.geometry import Spherical

CAMERA = Spherical(256, 128)


def test_noise_of_six_cameras_repeats_itself_at_the_poles_only():
    noise = pixel_choice.camera_noise(CAMERA, np.random.default_rng(0))
    step = np.abs(np.diff(noise, axis=1)).mean(axis=1)
    assert step[1] < 0.3 * step[CAMERA.height // 2]
    assert 0.4 * pixel_choice.NOISE < noise[CAMERA.height // 2].std() < pixel_choice.NOISE
