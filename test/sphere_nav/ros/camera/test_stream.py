"""Images by either transport: the topic, the pixels, and what is not unpacked."""

import cv2
import numpy as np
import pytest
from sensor_msgs.msg import CompressedImage, Image

from sphere_nav.ros.camera.stream import image_topic, panorama_of, read_gray
from sphere_nav.ros.conversions import Levels, array_to_image, header, image_to_rgb

COLORS = np.random.default_rng(0).integers(0, 256, (8, 16, 3), dtype=np.uint8)


def compressed(pixels, format_="png"):
    data = cv2.imencode(".png", cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR) if pixels.ndim == 3 else pixels)[1].tobytes()
    return CompressedImage(header=header(1, "optical"), format=format_, data=data)


def test_the_transport_decides_topic_and_kind_and_a_panorama_is_twice_as_wide_as_high():
    assert image_topic("image_raw", "raw") == ("image_raw", Image)
    assert image_topic("image_raw", "compressed") == ("image_raw/compressed", CompressedImage)
    found = image_topic("depth/image_raw", "compressed", is_depth=True)
    assert found == ("depth/image_raw/compressedDepth", CompressedImage)
    for message in (array_to_image(COLORS, 1, "optical", "rgb8"), compressed(COLORS)):
        camera = panorama_of(message)
        assert (camera.width, camera.height) == (16, 8)
    with pytest.raises(ValueError, match="twice as wide as high, found 8 x 8"):
        panorama_of(compressed(COLORS[:, :8]))


@pytest.mark.parametrize("size", [None, (16, 8)])
def test_pixels_are_the_same_by_either_transport_and_another_size_is_refused_by_whose_it_is_not(size):
    messages = array_to_image(COLORS, 1, "optical", "rgb8"), compressed(COLORS)
    for message in messages:
        np.testing.assert_array_equal(image_to_rgb(message, size=size), COLORS)
        np.testing.assert_array_equal(read_gray(message, size), cv2.cvtColor(COLORS, cv2.COLOR_RGB2GRAY))
    with pytest.raises(ValueError, match=r"expected 8 x 16 \(left\), found 16 x 8"):
        image_to_rgb(compressed(COLORS), size=(8, 16), size_name="left")


@pytest.mark.parametrize("size", [None, (16, 8)])
def test_a_dark_image_keeps_the_scale_of_the_bright_ones_of_its_stream(size):
    bright = np.linspace(0, 4095, 128).astype(np.uint16).reshape(8, 16)  # 12 bits
    dark = bright // 8
    for send in (lambda levels: array_to_image(levels, 1, "optical", "mono16"), compressed):
        stream, other = Levels(), Levels()
        for levels in (dark[:, :1].repeat(16, 1), bright, dark, bright):
            seen = read_gray(send(levels), size, stream)
        np.testing.assert_array_equal(seen, bright >> 4)
        np.testing.assert_array_equal(read_gray(send(dark), size, stream), dark >> 4)
        np.testing.assert_array_equal(read_gray(send(dark), size, other), dark >> 2)  # all that is known of it
