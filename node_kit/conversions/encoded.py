"""The size of a PNG or JPEG from its first bytes, so that absurd sizes are refused before anything is allocated."""

from __future__ import annotations

import struct

PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
JPEG_MAGIC = b"\xff\xd8"
START_OF_FRAME = {0xC0, 0xC1, 0xC2, 0xC3, 0xC5, 0xC6, 0xC7, 0xC9, 0xCA, 0xCB, 0xCD, 0xCE, 0xCF}
STANDALONE = {0x01, 0xFF, *range(0xD0, 0xD9)}


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
