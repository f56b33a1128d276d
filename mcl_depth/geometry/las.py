"""ASPRS .las and .laz of every version and point format (laspy, lazrs)."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
from numpy.typing import NDArray

CHUNK = 1_000_000  # points unpacked at once
HEADER = 375  # bytes of the longest header, that of version 1.4
RECORDS = ((100, 54), (243, 60))  # where a header counts its variable records, and the least bytes of one
MAX_PACKING = 100  # LAZ packs a point into no less than this share of its bytes


def read_las(path: Path) -> NDArray[np.float64]:
    """Return points (N, 3) float64 in the coordinates of the file."""
    size = path.stat().st_size
    with path.open("rb") as file:
        start = file.read(HEADER)
        if start[:4] != b"LASF":
            raise ValueError(f"{path}: header: expected 'LASF', found {start[:4]!r}")
        _check_records(path, start, size)
    try:
        with laspy.open(path) as reader:
            header = reader.header
            _check_header(path, header, size)
            parts = [np.column_stack([part.x, part.y, part.z]) for part in reader.chunk_iterator(CHUNK)]
    except (laspy.LaspyException, OSError, ValueError, RuntimeError, OverflowError, IndexError, KeyError) as error:
        text = " ".join(str(error).split())
        raise ValueError(
            text if text.startswith(str(path)) else f"{path}: expected a whole file, found {text}"
        ) from None
    except BaseException as error:  # lazrs is Rust: what it does not expect is a panic, which is no Exception
        if isinstance(error, (KeyboardInterrupt, SystemExit)):
            raise
        raise ValueError(f"{path}: points: expected LAZ, found damage") from None
    points = np.concatenate(parts) if parts else np.zeros((0, 3))
    if len(points) != header.point_count:
        raise ValueError(f"{path}: points: expected {header.point_count}, found {len(points)}")
    return points.astype(np.float64)


def _check_records(path: Path, start: bytes, size: int) -> None:
    """Refuse more variable records than the file has room for; laspy would read them one by one, beyond its end."""
    is_extended = start[24:26] >= bytes([1, 4])
    for place, least in RECORDS if is_extended else RECORDS[:1]:
        count = int.from_bytes(start[place : place + 4], "little")
        if count * least > size:
            raise ValueError(f"{path}: variable records: expected at most {size // least}, found {count}")


def _check_header(path: Path, header: laspy.LasHeader, size: int) -> None:
    """Refuse sizes that the file cannot have, before anything is allocated."""
    least = header.point_count * header.point_format.size // (MAX_PACKING if header.are_points_compressed else 1)
    if header.offset_to_point_data + least > size:
        raise ValueError(f"{path}: points: expected {header.point_count}, found a file of {size} bytes")
    numbers = np.concatenate([header.scales, header.offsets])
    if not np.all(np.isfinite(numbers)) or np.any(header.scales == 0.0):
        raise ValueError(f"{path}: scale and offset: expected finite numbers, found {header.scales}, {header.offsets}")
