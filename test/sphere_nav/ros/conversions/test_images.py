"""Images: every encoding, padding, byte order, and what is refused."""

import array

import cv2
import numpy as np
import pytest
from sensor_msgs.msg import CompressedImage, Image

from sphere_nav.ros.camera.stream import read_gray
from sphere_nav.ros.conversions import (
    array_to_image,
    depth_to_meters,
    image_to_array,
    image_to_rgb,
    stamp_ns,
)
from sphere_nav.ros.conversions.images import ENCODINGS, WITH_PLANE


def picture(rng, encoding):
    kind, channels = ENCODINGS[encoding]
    full = (5, 7, channels) if channels > 1 else (5, 7)
    return rng.normal(size=full).astype(kind) if kind is np.float32 else rng.integers(0, np.iinfo(kind).max, full, kind)


def test_an_image_comes_back(rng):
    for encoding in sorted(ENCODINGS.keys() - set(WITH_PLANE)):
        pixels = picture(rng, encoding)
        message = array_to_image(pixels, 12_000_000_034, "camera_optical", encoding)
        assert (message.width, message.height, message.header.frame_id) == (7, 5, "camera_optical")
        assert stamp_ns(message) == 12_000_000_034
        assert isinstance(message.data, array.array)
        found = image_to_array(message)
        assert found.dtype == pixels.dtype
        np.testing.assert_array_equal(found, pixels)


@pytest.mark.parametrize("encoding", ["rgb8", "16UC1"])
def test_padding_and_byte_order_are_honoured(rng, encoding):
    pixels = picture(rng, encoding)
    rows = pixels.astype(pixels.dtype.newbyteorder(">")).tobytes()
    row = len(rows) // 5
    padded = b"".join(rows[i * row : (i + 1) * row] + b"\xaa" * 5 for i in range(5))
    message = Image(width=7, height=5, encoding=encoding, step=row + 5, is_bigendian=1, data=array.array("B", padded))
    np.testing.assert_array_equal(image_to_array(message), pixels)


def test_color_is_rgb_whatever_the_order(rng):
    rgb = picture(rng, "rgb8")
    for encoding, pixels in (
        ("rgb8", rgb),
        ("bgr8", np.ascontiguousarray(rgb[..., ::-1])),
        ("8UC3", np.ascontiguousarray(rgb[..., ::-1])),
        ("rgba8", np.dstack([rgb, rgb[..., 0]])),
        ("bgra8", np.dstack([rgb[..., ::-1], rgb[..., 0]])),
    ):
        np.testing.assert_array_equal(image_to_rgb(array_to_image(pixels, 0, "", encoding)), rgb)
    with pytest.raises(ValueError, match="expected a grey or colour image, found '32FC1'"):
        read_gray(array_to_image(picture(rng, "32FC1"), 0, "", "32FC1"))
    gray = read_gray(array_to_image(rgb, 0, "", "rgb8"))
    expected = rgb @ np.array([0.299, 0.587, 0.114])
    np.testing.assert_allclose(gray, expected, atol=1.0)  # rounded to a grey level, with OpenCV's integer weights


def test_depth_is_in_meters_and_nan_where_there_is_none_or_told_with_the_factor():
    millimeters = np.array([[0, 1, 1500, 65535]], np.uint16)
    found = depth_to_meters(array_to_image(millimeters, 0, "", "16UC1"))
    np.testing.assert_allclose(found, [[np.nan, 0.001, 1.5, np.nan]], rtol=1e-6)
    meters = np.array([[np.nan, 0.0, -1.0, -np.inf, np.inf, 2.5]], np.float32)
    found = depth_to_meters(array_to_image(meters, 0, "", "32FC1"))
    np.testing.assert_array_equal(found, np.array([[np.nan, np.nan, np.nan, np.nan, np.inf, 2.5]], np.float32))
    with pytest.raises(ValueError, match="encoding of depth: expected 16UC1 or 32FC1, found 'mono8'"):
        depth_to_meters(array_to_image(np.zeros((2, 2), np.uint8), 0, "", "mono8"))
    for encoding, kind, value, factor in [
        ("32FC1", np.float32, 2300.0, "0.001"),
        ("32FC1", np.float32, 0.002, "1000"),
        ("16UC1", np.uint16, 3, "1000"),
    ]:
        with pytest.raises(ValueError, match=rf"depth \({encoding}\): median: expected metres, .*\(factor {factor}\)"):
            depth_to_meters(array_to_image(np.full((48, 64), value, kind), 0, "", encoding))
    meters = depth_to_meters(array_to_image(np.full((48, 64), 2300, np.uint16), 0, "", "16UC1"))
    assert meters[0, 0] == pytest.approx(2.3)
    assert np.isnan(depth_to_meters(array_to_image(np.zeros((48, 64), np.uint16), 0, "", "16UC1"))).all()


@pytest.mark.parametrize("shape", [(40, 60), (40, 60, 3)])
def test_compressed_images(shape):
    rows, columns = np.mgrid[0 : shape[0], 0 : shape[1]]
    planes = [rows * 4, columns * 3, rows + columns]
    pixels = (np.dstack(planes) if len(shape) == 3 else planes[0]).astype(np.uint8)
    data = cv2.imencode(".png", pixels[..., ::-1] if pixels.ndim == 3 else pixels)[1].tobytes()
    message = CompressedImage(format="png", data=array.array("B", data))
    np.testing.assert_array_equal(image_to_rgb(message), pixels)


BAYER = {"rggb": ("RG", "GB"), "bggr": ("BG", "GR"), "gbrg": ("GB", "RG"), "grbg": ("GR", "BG")}


def test_a_mosaic_of_one_color_is_that_color():
    for pattern in BAYER:
        color = {"R": 200, "G": 120, "B": 40}
        pixels = np.empty((8, 10), np.uint8)
        for row in range(2):
            for column in range(2):
                pixels[row::2, column::2] = color[BAYER[pattern][row][column]]
        rgb = image_to_rgb(array_to_image(pixels, 1, "c", f"bayer_{pattern}8"))
        np.testing.assert_array_equal(rgb[2:-2, 2:-2], np.broadcast_to([200, 120, 40], (4, 6, 3)))


def test_the_luminance_of_packed_yuv_is_the_gray_level_and_its_width_even():
    for encoding, order in [("yuv422", (1, 0)), ("uyvy", (1, 0)), ("yuyv", (0, 1))]:
        levels = np.arange(16, 236, 10, dtype=np.uint8)[None, :].repeat(4, axis=0)
        pixels = np.full((*levels.shape, 2), 128, np.uint8)
        pixels[..., order.index(0)] = levels
        rgb = image_to_rgb(array_to_image(pixels, 1, "c", encoding))
        assert rgb.shape == (*levels.shape, 3)
        expected = (levels.astype(float) - 16) * 255 / 219  # BT.601, limited range
        np.testing.assert_allclose(rgb[..., 1], expected, atol=2.0)
    message = Image(width=3, height=2, encoding="yuv422", step=6, data=array.array("B", bytes(12)))
    with pytest.raises(ValueError, match="expected an even number of pixels of yuv422, found 3"):
        image_to_rgb(message)


@pytest.mark.parametrize("bits", [10, 12, 14, 16])
def test_grey_levels_of_fewer_bits_fill_the_range(rng, bits):
    levels = rng.integers(0, 1 << bits, (40, 60)).astype(np.uint16)
    levels[3, 4] = (1 << bits) - 1
    gray = read_gray(array_to_image(levels, 0, "", "mono16"))
    np.testing.assert_array_equal(gray, levels >> (bits - 8))
    colors = image_to_rgb(array_to_image(levels, 0, "", "bayer_rggb16"))
    eight = array_to_image((levels >> (bits - 8)).astype(np.uint8), 0, "", "bayer_rggb8")
    np.testing.assert_array_equal(colors, image_to_rgb(eight))


def test_colors_behind_a_plane_of_grey_levels(rng):
    gray = np.full((6, 8), 120, np.uint8)
    for encoding, order in (("nv12", (90, 200)), ("nv21", (200, 90))):
        plane = np.tile(np.array(order, np.uint8), (3, 4))
        message = Image(height=6, width=8, step=8, encoding=encoding, data=np.vstack([gray, plane]).tobytes())
        rgb = image_to_rgb(message)
        assert rgb.shape == (6, 8, 3)
        assert (rgb[..., 0] > rgb[..., 2]).all()  # red: V is above U
        message.height, message.width = 9, 8
        with pytest.raises(ValueError, match="height: expected an even number of rows"):
            image_to_rgb(message)
    four = rng.integers(0, 256, (5, 7, 4), np.uint8)
    np.testing.assert_array_equal(image_to_rgb(array_to_image(four, 0, "", "8UC4")), four[..., 2::-1])
