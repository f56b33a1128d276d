"""PNG and JPEG: the size is read from the header, so that absurd ones are refused before anything is allocated."""

from __future__ import annotations

import struct
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

HEADER = 65536  # bytes within which a JPEG tells its size
PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
JPEG_MAGIC = b"\xff\xd8"
START_OF_FRAME = {0xC0, 0xC1, 0xC2, 0xC3, 0xC5, 0xC6, 0xC7, 0xC9, 0xCA, 0xCB, 0xCD, 0xCE, 0xCF}
STANDALONE = {0x01, 0xFF, *range(0xD0, 0xD9)}


def decode_file(
    data: Any, max_pixels: int, mode: int, size: tuple[int, int] | None = None, size_name: str = "camera_info"
) -> NDArray[Any]:
    """Return the pixels of a PNG or JPEG as cv2 does in this mode.

    ValueError for another kind of file, more than `max_pixels`, another size than `size` (width, height), or damage.
    """
    raw = np.frombuffer(data, np.uint8)
    width, height = encoded_size(raw[:HEADER].tobytes())
    if not 0 < width * height <= max_pixels:
        raise ValueError(f"image size: expected 1 to {max_pixels} pixels, found {width} x {height}")
    if size is not None and (width, height) != size:
        raise ValueError(f"image size: expected {size[0]} x {size[1]} ({size_name}), found {width} x {height}")
    try:
        pixels = cv2.imdecode(raw, mode | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error as error:
        raise ValueError(f"image data: expected an image, found {' '.join(str(error).split())}") from None
    if pixels is None or pixels.shape[1::-1] != (width, height):
        raise ValueError(f"image data: expected an image, found {raw.size} bytes that do not decode")
    return pixels


def encoded_size(data: bytes) -> tuple[int, int]:
    """Return (width, height); ValueError if the bytes begin neither a PNG nor a JPEG file."""
    if data.startswith(PNG_MAGIC) and len(data) >= 24:
        width, height = struct.unpack(">II", data[16:24])
        return width, height
    if data.startswith(JPEG_MAGIC):
        return _jpeg_size(data)
    raise ValueError(f"image data: expected PNG or JPEG, found bytes {data[:8].hex(' ')}")


def _jpeg_size(data: bytes) -> tuple[int, int]:
    place = 2
    while place + 9 <= len(data) and data[place] == 0xFF:
        marker = data[place + 1]
        if marker in START_OF_FRAME:
            height, width = struct.unpack(">HH", data[place + 5 : place + 9])
            return width, height
        place += 2 if marker in STANDALONE else 2 + struct.unpack(">H", data[place + 2 : place + 4])[0]
    raise ValueError("image data: expected the size of a JPEG image, found none in its header")
