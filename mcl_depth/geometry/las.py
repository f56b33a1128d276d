"""ASPRS .las and .laz of every version and point format (laspy, lazrs).

lazrs aborts, or asks for all memory, on what some lengths in a .laz say: it is read by a process of its own.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mcl_depth.constants import MAX_KEPT
from mcl_depth.geometry.tiles import Thinner
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.files.isolated import read_isolated
from sphere_nav.geometry.files.untrusted import MAX_ARRAY_BYTES, open_file

CHUNK_BYTES = 1 << 25  # of points unpacked at once
HEADER = np.dtype(  # of version 1.4, the longest: what is read of it
    {
        "names": ["magic", "version", "begin", "records", "format", "length", "count", "extent", "more", "long_count"],
        "formats": ["S4", "2u1", "<u4", "<u4", "u1", "<u2", "<u4", "4<f8", "<u4", "<u8"],
        "offsets": [0, 24, 96, 100, 104, 105, 107, 179, 243, 247],
        "itemsize": 375,
    }
)
SHORTEST = 227  # bytes of the shortest header
PACKED = 0x80  # of the format, in a .laz
MAX_PACKING = 100  # LAZ packs a point into no less than this share of its bytes
READ_S, BYTES_PER_S = 30.0, 1e6  # a process is given that time, and more by the size of the file


def read_las(path: Path, box: Array | None = None) -> NDArray[np.float64]:
    """Return points (N, 3) float64 in the coordinates of the file; of more than MAX_KEPT some, evenly over space.

    `box` (x0, y0, x1, y1), in these coordinates, is all that is read.
    """
    size = path.stat().st_size
    head, count, length = _head_of(path)
    x1, x0, y1, y0 = head["extent"]
    if box is not None and (x1 < box[0] or x0 > box[2] or y1 < box[1] or y0 > box[3]):
        return np.zeros((0, 3))
    words = [] if box is None else [repr(float(value)) for value in box]
    if head["format"] < PACKED:
        return read_points(path, *words)
    max_bytes = 4 * CHUNK_BYTES + (4 * 24 + length) * min(count, 2 * MAX_KEPT)
    points: NDArray[np.float64] = read_isolated(read_points, path, max_bytes, READ_S + size / BYTES_PER_S, *words)
    return points


def read_points(path: Path, *box: str) -> NDArray[np.float64]:
    """Return points (N, 3) float64; what lazrs does not expect may end the process."""
    import laspy  # a quarter of a second, which nodes with other maps need not take

    kept = Thinner(np.array([float(word) for word in box]) if box else None)
    num_read = 0
    try:
        with laspy.open(path, laz_backend=laspy.LazBackend.LazrsParallel) as reader:  # the other reads beyond
            header = reader.header
            numbers = np.concatenate([header.scales, header.offsets])
            if not np.all(np.isfinite(numbers)) or np.any(header.scales == 0.0):
                found = f"{header.scales}, {header.offsets}"
                raise ValueError(f"{path}: scale and offset: expected finite numbers, found {found}")
            steps = reader.chunk_iterator(max(CHUNK_BYTES // header.point_format.size, 1))
            for part in steps:
                kept.add(np.column_stack([part.x, part.y, part.z]))
                num_read += len(part)
    except (laspy.LaspyException, OSError, ValueError, RuntimeError, OverflowError, IndexError, KeyError) as error:
        text = " ".join(str(error).split()).removeprefix("IoError: ")
        raise ValueError(
            text if text.startswith(str(path)) else f"{path}: expected a whole file, found {text}"
        ) from None
    except BaseException as error:  # lazrs is Rust: what it does not expect is a panic, which is no Exception
        if isinstance(error, (KeyboardInterrupt, SystemExit, MemoryError)):
            raise
        raise ValueError(f"{path}: points: expected LAZ, found damage") from None
    if num_read != header.point_count:
        raise ValueError(f"{path}: points: expected {header.point_count}, found {num_read}")
    return kept.points()


def count_las(path: Path) -> int:
    """Return the number of points that a file says it has; ValueError where it cannot have them."""
    return _head_of(path)[1]


def _head_of(path: Path) -> tuple[np.void, int, int]:
    """Return the header, the number of points and the bytes of one."""
    with open_file(path, "map", MAX_ARRAY_BYTES) as file:
        start = file.read(HEADER.itemsize) or b""
    if start[:4] != b"LASF" or len(start) < SHORTEST:
        raise ValueError(f"{path}: header: expected 'LASF' and {SHORTEST} bytes, found {len(start)}: {start[:4]!r}")
    head = np.frombuffer(start.ljust(HEADER.itemsize, b"\0"), HEADER)[0]
    return head, *_check_head(path, head, path.stat().st_size)


def _check_head(path: Path, head: np.void, size: int) -> tuple[int, int]:
    """Return the number of points and the bytes of one; ValueError for more points or records than the file has room.

    laspy would read the records one by one, beyond the end.
    """
    if head["begin"] > size:  # all before it is read at once
        raise ValueError(f"{path}: points: expected within {size} bytes, found at {head['begin']}")
    is_extended = tuple(head["version"]) >= (1, 4)
    for name, least in (("records", 54), ("more", 60))[: 1 + is_extended]:  # bytes of one, at least
        if (count := int(head[name])) * least > size:
            raise ValueError(f"{path}: variable records: expected at most {size // least}, found {count}")
    count, length = int(head["long_count" if is_extended else "count"]), int(head["length"])
    if count * max(length, 1) // (MAX_PACKING if head["format"] >= PACKED else 1) > size:
        raise ValueError(f"{path}: points: expected {count}, found a file of {size} bytes")
    return count, length
