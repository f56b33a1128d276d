"""Local contrast: what light changes little."""

import numpy as np
import pytest

from sphere_nav.geometry import Pinhole, Spherical
from sphere_nav.photometric.constants import CONTRAST_ANGLE, CONTRAST_MEAN, CONTRAST_PIXELS, CONTRAST_SCALE
from sphere_nav.photometric.pixels.contrast import contrast_window, local_contrast

CAMERA = Pinhole(320, 240, 250.0, 250.0, 159.5, 119.5)
WINDOW = 0.04


def texture(camera, seed=0):
    """Return noise that is smooth over some pixels, with deviation 30, around 128."""
    rng = np.random.default_rng(seed)
    noise = rng.normal(size=(camera.height, camera.width))
    spectrum = np.fft.rfft2(noise)
    u = np.fft.rfftfreq(camera.width)[None] * 8.0
    v = np.fft.fftfreq(camera.height)[:, None] * 8.0
    smooth = np.fft.irfft2(spectrum * np.exp(-0.5 * (u**2 + v**2) * 9.0), s=noise.shape)
    return 128.0 + 30.0 * smooth / smooth.std()


def to_bytes(values):
    return np.clip(np.rint(values), 1, 255).astype(np.uint8)


def correlation(a, b):
    return float(np.corrcoef(a.ravel().astype(float), b.ravel().astype(float))[0, 1])


def test_a_lamp_and_a_shadow_change_it_little():
    """Half the brightness to one side, and a lamp that falls off from the middle."""
    image = texture(CAMERA)
    u, v = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
    ramp = 0.4 + 0.6 * u / CAMERA.width
    lamp = 0.3 + np.exp(-((u - 160) ** 2 + (v - 120) ** 2) / (2.0 * 80.0**2))
    before = local_contrast(to_bytes(image), CAMERA, WINDOW)
    for light in (ramp, lamp):
        seen = to_bytes(image * light)
        assert correlation(seen, image) < 0.85
        assert correlation(local_contrast(seen, CAMERA, WINDOW), before) > 0.97


def test_its_mean_and_deviation_are_the_same_everywhere():
    image = texture(CAMERA)
    image[:, 160:] = 60.0 + 0.4 * (image[:, 160:] - 128.0)
    contrast = local_contrast(to_bytes(image), CAMERA, WINDOW).astype(float)
    for part in (contrast[20:-20, 20:120], contrast[20:-20, 200:-20]):
        assert part.mean() == pytest.approx(CONTRAST_MEAN, abs=4.0)
        assert 0.5 * CONTRAST_SCALE < part.std() < 1.1 * CONTRAST_SCALE


def test_noise_is_not_made_texture():
    rng = np.random.default_rng(1)
    flat = to_bytes(100.0 + rng.normal(0.0, 1.0, (CAMERA.height, CAMERA.width)))
    assert local_contrast(flat, CAMERA, WINDOW).std() < 0.2 * CONTRAST_SCALE
    even = np.full((CAMERA.height, CAMERA.width), 77, np.uint8)
    np.testing.assert_array_equal(local_contrast(even, CAMERA, WINDOW), CONTRAST_MEAN)


def test_a_sphere_has_no_seam():
    """Turned by some columns it shows the same, turned by as many."""
    camera = Spherical(512, 256, 512.0)
    image, by = to_bytes(texture(camera, 2)), 128
    turned = local_contrast(np.roll(image, by, axis=1), camera, 0.1).astype(int)
    assert np.abs(np.roll(turned, -by, axis=1) - local_contrast(image, camera, 0.1)).max() <= 1


def test_the_window_is_an_angle_and_some_pixels_at_least():
    assert contrast_window(Spherical(4096, 2048, 4096.0)) == CONTRAST_ANGLE
    coarse = Spherical(256, 128, 256.0)
    assert contrast_window(coarse) * coarse.pixels_per_radian == pytest.approx(CONTRAST_PIXELS)
