"""Spheres: both encodings of images, windows, and sizes that are checked before anything is allocated."""

import numpy as np
import pytest

from sphere_nav.geometry import Spherical
from sphere_nav.ros.conversions import message_to_sphere, sphere_to_message
from sphere_nav.spheres.sphere import Sphere

CAMERAS = [Spherical(64, 32), Spherical(24, 10, 64.0, -3.0, 8.0), Spherical(20, 8, 50.5, 3.25, 4.5)]


def make(rng, camera=CAMERAS[1], is_color=True):
    rows, columns = np.mgrid[0 : camera.height, 0 : camera.width]
    smooth = (100 + rows + columns).astype(np.uint8)
    image = np.dstack([smooth, smooth + 20, smooth - 20]) if is_color else smooth
    range_m = rng.uniform(0.5, 80.0, image.shape[:2]).astype(np.float32)
    range_m[0], range_m[1] = np.nan, np.inf
    return Sphere(image, range_m, camera, 8_000_000_009)


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("is_png", [False, True])
@pytest.mark.parametrize("is_color", [False, True])
def test_a_sphere_comes_back(rng, camera, is_png, is_color):
    sphere = make(rng, camera, is_color)
    message = sphere_to_message(sphere, "sphere_link", 7, is_png=is_png)
    assert (message.id, message.header.frame_id, message.info.frame_id) == (7, "sphere_link", "sphere_link")
    assert message.image_encoding == ("png" if is_png else "rgb8" if is_color else "mono8")
    found = message_to_sphere(message)
    assert found.camera == camera
    assert found.stamp_ns == sphere.stamp_ns
    np.testing.assert_array_equal(found.image, sphere.image)
    np.testing.assert_allclose(found.range_m, sphere.range_m, rtol=1.1e-4)  # half a step of the logarithmic code


@pytest.mark.parametrize("is_png", [False, True])
@pytest.mark.parametrize("is_color", [True, False])
def test_for_alignment_gray_levels_and_range_alone_are_read(rng, is_png, is_color):
    plain = make(rng, is_color=is_color)
    sphere = Sphere(plain.image, plain.range_m, plain.camera, 1, np.full_like(plain.range_m, 0.25))
    message = sphere_to_message(sphere, "s", is_png=is_png)
    found, whole = message_to_sphere(message, is_gray=True), message_to_sphere(message)
    assert (found.image.shape, found.image.dtype, found.range_std_m) == (plain.range_m.shape, np.uint8, None)
    np.testing.assert_allclose(found.levels, whole.gray, atol=0.6)  # half a grey level, and the codec's own weights
    np.testing.assert_array_equal(found.range_m, whole.range_m)


def test_a_deviation_comes_along(rng):
    plain = make(rng)
    sphere = Sphere(plain.image, plain.range_m, plain.camera, 1, np.full_like(plain.range_m, 0.25))
    found = message_to_sphere(sphere_to_message(sphere, "s"))
    expected = np.where(plain.measured, np.clip(0.25, 1e-4 * plain.range_m, 0.3137 * plain.range_m), np.nan)
    np.testing.assert_allclose(found.range_std_m, expected, rtol=0.019)  # half a step of 3.7 %, and that of the range
    old = sphere_to_message(sphere, "s")
    old.range_deviation_encoding, old.range_deviation = old.range_encoding, old.range
    with pytest.raises(ValueError, match=r"range_deviation_encoding: expected ratio8, found 'log16'"):
        message_to_sphere(old)
    assert message_to_sphere(sphere_to_message(plain, "s")).range_std_m is None
