"""Spheres: every encoding, windows, and sizes that are checked before anything is allocated."""

import numpy as np
import pytest
from sphere_nav_msgs.msg import AugmentedSphere

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
@pytest.mark.parametrize("image_encoding", ["bgr8", "png", "jpeg"])
@pytest.mark.parametrize("range_encoding", ["32FC1", "log16", "log16_zstd"])
def test_a_sphere_comes_back(rng, camera, image_encoding, range_encoding):
    sphere = make(rng, camera)
    message = sphere_to_message(sphere, "sphere_link", 7, image_encoding=image_encoding, range_encoding=range_encoding)
    assert (message.id, message.header.frame_id, message.info.frame_id) == (7, "sphere_link", "sphere_link")
    found = message_to_sphere(message)
    assert found.camera == camera
    assert found.stamp_ns == sphere.stamp_ns
    image_tolerance = 8 if image_encoding == "jpeg" else 0  # smooth colours at quality 95
    np.testing.assert_allclose(found.image.astype(int), sphere.image.astype(int), atol=image_tolerance)
    range_tolerance = 0 if range_encoding == "32FC1" else 1.1e-4  # half a step of the logarithmic code
    np.testing.assert_allclose(found.range_m, sphere.range_m, rtol=range_tolerance)


@pytest.mark.parametrize("image_encoding", ["", "jpeg"])
@pytest.mark.parametrize("is_color", [True, False])
def test_for_alignment_gray_levels_and_range_alone_are_read(rng, image_encoding, is_color):
    if image_encoding == "bgr8" and not is_color:
        pytest.skip("no colours to turn")
    plain = make(rng, is_color=is_color)
    sphere = Sphere(plain.image, plain.range_m, plain.camera, 1, np.full_like(plain.range_m, 0.25))
    message = sphere_to_message(sphere, "s", image_encoding=image_encoding)
    found, whole = message_to_sphere(message, is_gray=True), message_to_sphere(message)
    assert (found.image.shape, found.image.dtype, found.range_std_m) == (plain.range_m.shape, np.uint8, None)
    tolerance = 3.0 if image_encoding == "jpeg" else 0.6  # half a grey level, and the codec's own weights
    np.testing.assert_allclose(found.levels, whole.gray, atol=tolerance)
    np.testing.assert_array_equal(found.range_m, whole.range_m)


def test_a_deviation_comes_along(rng):
    plain = make(rng)
    sphere = Sphere(plain.image, plain.range_m, plain.camera, 1, np.full_like(plain.range_m, 0.25))
    found = message_to_sphere(sphere_to_message(sphere, "s"))
    expected = np.where(plain.measured, np.clip(0.25, 1e-4 * plain.range_m, 0.3137 * plain.range_m), np.nan)
    np.testing.assert_allclose(found.range_std_m, expected, rtol=0.019)  # half a step of 3.7 %, and that of the range
    old = sphere_to_message(sphere, "s")
    old.range_deviation_encoding, old.range_deviation = old.range_encoding, old.range
    with pytest.raises(ValueError, match=r"range_deviation_encoding: expected 32FC1, ratio8, .*, found 'log16'"):
        message_to_sphere(old)
    assert message_to_sphere(sphere_to_message(plain, "s")).range_std_m is None


def test_zero_and_negative_range_are_unknown(rng):
    message = sphere_to_message(make(rng), "s", range_encoding=AugmentedSphere.RANGE_32FC1)
    values = np.frombuffer(message.range, np.float32).copy()
    values[:3] = (0.0, -1.0, -np.inf)
    message.range = values.tobytes()
    assert np.isnan(message_to_sphere(message).range_m.ravel()[:3]).all()


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda m: setattr(m.info, "full_height", 31.0), "full_width: expected 2 \\* full_height"),
        (lambda m: setattr(m.info, "width", 65), "info.width, height: expected up to 64.0 x 32.0, found 65 x 10"),
        (lambda m: setattr(m, "image_encoding", "tiff"), "image_encoding: expected mono8, .* found 'tiff'"),
        (lambda m: setattr(m, "image_encoding", "mono8"), "image: expected 240 bytes, found 720"),
        (lambda m: setattr(m, "range_encoding", "32FC1"), "range: expected 960 bytes, found 480"),
    ],
)
def test_a_message_that_contradicts_itself_is_refused(rng, change, reason):
    message = sphere_to_message(make(rng), "s")
    change(message)
    with pytest.raises(ValueError, match=reason):
        message_to_sphere(message)


def test_a_picture_file_of_another_size_is_refused(rng):
    message = sphere_to_message(make(rng), "s", image_encoding="png")
    message.image = sphere_to_message(make(rng, CAMERAS[0]), "s", image_encoding="png").image
    with pytest.raises(ValueError, match=r"image: image size: expected 24 x 10 \(info\), found 64 x 32"):
        message_to_sphere(message)
