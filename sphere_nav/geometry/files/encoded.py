"""PNG and JPEG: the size is read from the header, so that absurd ones are refused before anything is allocated.

Files of images may be of any other kind that OpenCV reads (TIFF, BMP, PGM, ...): by a process of its own.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry.arrays import Size
from sphere_nav.geometry.cameras.camera import MAX_PIXELS
from sphere_nav.geometry.files.isolated import read_isolated
from sphere_nav.geometry.files.untrusted import LIMITS, AnyPath, printable, read_bytes, told_at

HEADER = 65536  # bytes within which a JPEG tells its size
PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
JPEG_MAGIC = b"\xff\xd8"
START_OF_FRAME = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}  # of these three are tables
STANDALONE = {0x01, 0xFF, *range(0xD0, 0xD9)}
OTHER_BYTES, OTHER_S = 1 << 30, 20.0  # of memory and of time for a file of another kind


def read_image_file(path: AnyPath, mode: int, what: str = "file of an image") -> NDArray[Any]:
    """Return the pixels of a file as cv2 does in this mode; ValueError in one line for anything else than an image."""
    data = read_bytes(path, what, LIMITS["image file"])
    if data.startswith((PNG_MAGIC, JPEG_MAGIC)):
        with told_at(path):
            return decode_file(data, MAX_PIXELS, mode)
    return np.asarray(read_isolated(_read_other, Path(path), OTHER_BYTES, OTHER_S, str(mode)))


def _read_other(path: Path, mode: str) -> NDArray[Any]:
    """Return the pixels of a file of any kind; it may end the process."""
    pixels = cv2.imdecode(np.fromfile(path, np.uint8), int(mode) | cv2.IMREAD_IGNORE_ORIENTATION)
    if pixels is None or pixels.size > 4 * MAX_PIXELS:
        raise ValueError(f"{path}: expected an image, found a file that cannot be read as one")
    return np.asarray(pixels)


def decode_file(
    data: Any, max_pixels: int, mode: int, size: Size | None = None, size_name: str = "camera_info"
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
        raise ValueError(f"image data: expected an image, found {printable(str(error))}") from None
    if pixels is None or pixels.shape[1::-1] != (width, height):
        raise ValueError(f"image data: expected an image, found {raw.size} bytes that do not decode")
    return np.asarray(pixels)


def encoded_size(data: bytes) -> Size:
    """Return (width, height); ValueError if the bytes begin neither a PNG nor a JPEG file."""
    if data.startswith(PNG_MAGIC) and len(data) >= 24:
        width, height = struct.unpack(">II", data[16:24])
        return width, height
    if data.startswith(JPEG_MAGIC):
        return _jpeg_size(data)
    raise ValueError(f"image data: expected PNG or JPEG, found bytes {data[:8].hex(' ')}")


def _jpeg_size(data: bytes) -> Size:
    place = 2
    while place + 9 <= len(data) and data[place] == 0xFF:
        marker = data[place + 1]
        if marker in START_OF_FRAME:
            height, width = struct.unpack(">HH", data[place + 5 : place + 9])
            return width, height
        place += 2 if marker in STANDALONE else 2 + struct.unpack(">H", data[place + 2 : place + 4])[0]
    raise ValueError("image data: expected the size of a JPEG image, found none in its header")
