"""ASPRS .las 1.0 to 1.4, uncompressed, every point format."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

SMALLEST = (20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67)  # bytes of a point of formats 0 to 10
HEADER = 227  # bytes of the header of 1.0 to 1.2
HEADER_14 = 375


def read_las(path: Path) -> NDArray[np.float64]:
    """Return points (N, 3) float64 in the coordinates of the file."""
    with path.open("rb") as file:
        head = file.read(HEADER_14)
        size = file.seek(0, 2)
        if not head.startswith(b"LASF") or len(head) < HEADER:
            raise ValueError(f"{path}: header: expected {HEADER} bytes from 'LASF', found {head[:8]!r}, {size} bytes")
        start, length, count = _layout(path, head)
        if start < HEADER or start + count * length > size:
            raise ValueError(f"{path}: points: expected {count} of {length} bytes from {start}, found {size} bytes")
        scale = np.array(struct.unpack_from("<3d", head, 131))
        offset = np.array(struct.unpack_from("<3d", head, 155))
        if not (np.all(np.isfinite(scale)) and np.all(scale != 0) and np.all(np.isfinite(offset))):
            raise ValueError(f"{path}: scale and offset: expected finite numbers, found {scale} and {offset}")
        file.seek(start)
        rows = np.frombuffer(file.read(count * length), np.dtype((np.void, length)), count)
    row = np.dtype({"names": ["p"], "formats": [("<i4", 3)], "offsets": [0], "itemsize": length})
    return rows.view(row)["p"] * scale + offset


def _layout(path: Path, head: bytes) -> tuple[int, int, int]:
    """Return where the points start, the bytes of each, and how many there are."""
    major, minor = head[24], head[25]
    if (major, minor) not in ((1, 0), (1, 1), (1, 2), (1, 3), (1, 4)):
        raise ValueError(f"{path}: version: expected 1.0 to 1.4, found {major}.{minor}")
    (start,) = struct.unpack_from("<I", head, 96)
    form, length, count = struct.unpack_from("<BHI", head, 104)
    if form & 0xC0:
        raise ValueError(f"{path}: point format: expected uncompressed points, found LAZ (convert with 'laszip')")
    if form >= len(SMALLEST) or length < SMALLEST[form]:
        raise ValueError(f"{path}: point format: expected 0 to 10 of known length, found {form} of {length} bytes")
    if minor == 4 and len(head) == HEADER_14:
        count = struct.unpack_from("<Q", head, 247)[0] or count
    return start, length, count
