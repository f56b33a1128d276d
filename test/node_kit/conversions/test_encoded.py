"""Sizes are read from the first bytes of a file."""

import cv2
import numpy as np
import pytest

from node_kit.conversions.encoded import encoded_size


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
