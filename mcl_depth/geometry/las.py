"""ASPRS .las and .laz of every version and point format (laspy, lazrs).

lazrs aborts, or asks for all memory, on what some lengths in a .laz say: it is read by a process of its own.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mcl_depth.constants import MAX_KEPT
from mcl_depth.geometry.tiles import Thinner
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.files.isolated import read_isolated
from sphere_nav.geometry.files.untrusted import MAX_ARRAY_BYTES, open_file, printable

ENDINGS = (".las", ".laz")
CHUNK_BYTES = 1 << 25  # of points unpacked at once
RECORD_BYTES = 54  # of a record before the points, at least
MAX_PACKING = 100  # LAZ packs a point into no less than this share of its bytes
READ_S, BYTES_PER_S = 30.0, 1e6  # a process is given that time, and more by the size of the file


def read_header(path: Path) -> Any:
    """Return laspy's header; ValueError for more records or points than the file has room for.

    laspy would read records one by one, beyond the end.
    """
    from laspy import LasHeader  # a quarter of a second, which nodes with other maps need not take

    with open_file(path, "map", MAX_ARRAY_BYTES) as file:
        size = os.fstat(file.fileno()).st_size
        begin, records = struct.unpack_from("<II", file.read(104).ljust(104, b"\0"), 96)
        if not RECORD_BYTES * records <= begin <= size:
            found = f"{records} records before points at {begin}"
            raise ValueError(f"{path}: header: expected room for all in {size} bytes, found {found}")
        file.seek(0)
        with _told(path):
            header = LasHeader.read_from(file)
    packing = MAX_PACKING if header.are_points_compressed else 1
    if header.point_count * header.point_format.size > packing * size:
        raise ValueError(f"{path}: points: expected {header.point_count}, found a file of {size} bytes")
    if not np.all(np.isfinite([header.scales, header.offsets])) or np.any(header.scales == 0.0):
        found = f"{header.scales}, {header.offsets}"
        raise ValueError(f"{path}: scale and offset: expected finite numbers, found {found}")
    return header


def read_las(path: Path, box: Array | None = None) -> NDArray[np.float64]:
    """Return points (N, 3) float64 in the coordinates of the file; of more than MAX_KEPT some, evenly over space.

    `box` (x0, y0, x1, y1), in these coordinates, is all that is read.
    """
    header = read_header(path)
    if box is not None and (np.any(header.maxs[:2] < box[:2]) or np.any(header.mins[:2] > box[2:])):
        return np.zeros((0, 3))
    words = [] if box is None else [repr(float(value)) for value in box]
    if not header.are_points_compressed:
        return read_points(path, *words)
    max_bytes = 4 * CHUNK_BYTES + (4 * 24 + header.point_format.size) * min(header.point_count, 2 * MAX_KEPT)
    points: NDArray[np.float64] = read_isolated(read_points, path, max_bytes, seconds_for(path), *words)
    return points


def seconds_for(path: Path) -> float:
    """Return the time that a process is given to read a file."""
    return READ_S + path.stat().st_size / BYTES_PER_S


def read_points(path: Path, *box: str) -> NDArray[np.float64]:
    """Return points (N, 3) float64; what lazrs does not expect may end the process."""
    import laspy

    kept, backend = Thinner(np.array(box, np.float64) if box else None), laspy.LazBackend.LazrsParallel
    with _told(path), laspy.open(path, laz_backend=backend, read_evlrs=False) as reader:  # the other reads beyond
        for part in reader.chunk_iterator(max(CHUNK_BYTES // reader.header.point_format.size, 1)):
            kept.add(np.column_stack([part.x, part.y, part.z]))
    if reader.points_read != reader.header.point_count:
        raise ValueError(f"{path}: points: expected {reader.header.point_count}, found {reader.points_read}")
    return kept.points()


@contextmanager
def _told(path: Path) -> Iterator[None]:
    """ValueError in one line for whatever laspy raises of damage; a panic of lazrs, which is Rust, is no Exception."""
    try:
        yield
    except (KeyboardInterrupt, SystemExit, MemoryError):
        raise
    except BaseException as error:
        raise ValueError(f"{path}: expected a whole .las or .laz, found {printable(str(error))[:200]}") from None
