"""Sizes are read from the first bytes of a file."""

import cv2
import numpy as np
import pytest

from sphere_nav.ros.conversions.encoded import decode_file, encoded_size


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
@pytest.mark.parametrize("shape", [(1, 1), (17, 300), (9, 5, 3)])
def test_the_size_of_a_file(suffix, shape):
    data = cv2.imencode(suffix, np.zeros(shape, np.uint8))[1].tobytes()
    assert encoded_size(data) == (shape[1], shape[0])


def test_a_progressive_jpeg():
    data = cv2.imencode(".jpg", np.zeros((12, 34, 3), np.uint8), [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])[1].tobytes()
    assert encoded_size(data) == (34, 12)


@pytest.mark.parametrize("data", [b"", b"\xff\xd8", b"\xff\xd8\xff\xe0\x00", b"\x89PNG\r\n\x1a\n", b"GIF89a"])
def test_anything_else_is_refused(data):
    with pytest.raises(ValueError, match="image data: expected"):
        encoded_size(data)


def test_a_picture_stays_as_the_sensor_made_it():
    """The orientation that a camera writes into a JPEG is for people; the calibration is of the sensor."""
    exif = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0"
    data = cv2.imencode(".jpg", np.zeros((12, 34), np.uint8))[1].tobytes()
    turned = data[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + data[2:]
    assert cv2.imdecode(np.frombuffer(turned, np.uint8), cv2.IMREAD_ANYCOLOR).shape == (34, 12)
    assert decode_file(turned, 1000, cv2.IMREAD_ANYCOLOR).shape == (12, 34)
    with pytest.raises(ValueError, match="expected 1 to 407 pixels, found 34 x 12"):
        decode_file(turned, 407, cv2.IMREAD_ANYCOLOR)
