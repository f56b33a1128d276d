"""Sizes are read from the first bytes of a file."""

import cv2
import numpy as np
import pytest

from sphere_nav.geometry.files.encoded import decode_file, encoded_size, read_image_file


def test_a_picture_stays_as_the_sensor_made_it():
    """The orientation that a camera writes into a JPEG is for people; the calibration is of the sensor."""
    exif = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0"
    data = cv2.imencode(".jpg", np.zeros((12, 34), np.uint8))[1].tobytes()
    turned = data[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + data[2:]
    assert cv2.imdecode(np.frombuffer(turned, np.uint8), cv2.IMREAD_ANYCOLOR).shape == (34, 12)
    assert decode_file(turned, 1000, cv2.IMREAD_ANYCOLOR).shape == (12, 34)
    with pytest.raises(ValueError, match="expected 1 to 407 pixels, found 34 x 12"):
        decode_file(turned, 407, cv2.IMREAD_ANYCOLOR)


def jpeg(marker, before=b""):
    """The beginning of a JPEG of 300 x 20: segments, then a frame header of this kind (ITU-T T.81, B.2.2)."""
    return b"\xff\xd8" + before + bytes([0xFF, marker]) + b"\x00\x0b\x08" + b"\x00\x14\x01\x2c" + b"\x01\x01\x11\x00"


def test_every_kind_of_frame_tells_its_size_and_tables_do_not():
    tables = {0xC4, 0xC8, 0xCC}  # DHT, JPG and DAC are segments: what follows is read
    for marker in {*range(0xC0, 0xD0)} - tables:  # SOF0 to SOF15
        assert encoded_size(jpeg(marker)) == (300, 20)
    for marker in tables:
        assert encoded_size(jpeg(0xC0, bytes([0xFF, marker]) + b"\x00\x05abc")) == (300, 20)


def test_the_size_may_be_known_before_and_may_be_as_large_as_allowed(tmp_path):
    data = cv2.imencode(".png", np.zeros((12, 34), np.uint8))[1].tobytes()
    assert decode_file(data, 408, cv2.IMREAD_ANYCOLOR, (34, 12)).shape == (12, 34)
    with pytest.raises(ValueError, match=r"expected 12 x 34 \(rig\), found 34 x 12"):
        decode_file(data, 408, cv2.IMREAD_ANYCOLOR, (12, 34), "rig")
    (tmp_path / "a.png").write_bytes(data[:40])
    with pytest.raises(ValueError, match=r"^\S+a\.png: image data: expected an image, found .* that do not decode"):
        read_image_file(tmp_path / "a.png", cv2.IMREAD_ANYCOLOR)


@pytest.mark.parametrize("name", ["a.png", pytest.param("a.bmp", marks=pytest.mark.dds)])  # by a process of its own
def test_a_file_of_any_kind_is_read(tmp_path, name):
    pixels = np.random.default_rng(1).integers(0, 255, (5, 7), np.uint8)
    cv2.imwrite(str(tmp_path / name), pixels)
    assert np.array_equal(read_image_file(tmp_path / name, cv2.IMREAD_GRAYSCALE), pixels)
