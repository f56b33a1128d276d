"""Point Cloud Library .pcd: ascii, binary and binary_compressed (LZF, one field after the other)."""

from __future__ import annotations

import re
from math import prod
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mcl_depth.constants import MAX_HEADER, MAX_LZF_RATIO
from mcl_depth.geometry import kernels
from mcl_depth.geometry.ply import floats_of_text, points_of, rows_of
from sphere_nav.geometry.files.untrusted import MAX_ARRAY_BYTES, read_bytes

TYPES = {"F4", "F8", "I1", "I2", "I4", "I8", "U1", "U2", "U4", "U8"}
MAX_REPEAT = 4096  # numbers of one field
AXES = {"x", "y", "z"}


def read_pcd(path: Path) -> NDArray[np.float64]:
    """Return points (N, 3)."""
    data = read_bytes(path, "map", MAX_ARRAY_BYTES)
    head = re.match(rb"(?:.*\n)*?DATA +(ascii|binary|binary_compressed)\s*?\n", data[:MAX_HEADER])
    if head is None:
        raise ValueError(f"{path}: header: expected a line DATA ascii, binary or binary_compressed, found none")
    row, count = _header(path, head[0].decode("ascii", "replace"), is_text=head[1] == b"ascii")
    body = data[head.end() :]
    if head[1] == b"ascii":
        body = floats_of_text(path, body)
    if head[1] != b"binary_compressed":
        return points_of(rows_of(f"{path}: POINTS", body, row, count))
    plain, columns = _decompress(path, body, count * row.itemsize), {}
    for axis in AXES:
        kind, offset = row.fields[axis][:2]  # type: ignore[index]
        columns[axis] = np.frombuffer(plain, kind, count, offset * count)
    return points_of(columns)


def _header(path: Path, text: str, *, is_text: bool) -> tuple[np.dtype, int]:
    """Return what one point looks like, and how many there are."""
    words = {name: rest for name, *rest in map(str.split, filter(str.strip, text.splitlines()))}
    try:
        fields, count = words["FIELDS"], prod(map(int, words.get("POINTS") or words["WIDTH"] + words["HEIGHT"]))
        repeats = [int(word) for word in words.get("COUNT", ["1"] * len(fields))]
        listed = list(zip(fields, words["TYPE"], words["SIZE"], repeats, strict=True))
    except (KeyError, ValueError) as error:
        raise ValueError(f"{path}: header: expected FIELDS, SIZE, TYPE, POINTS and DATA, found {error!s:.80}") from None
    if count < 0 or any(kind + size not in TYPES for _, kind, size, _ in listed):
        found = f"{words['TYPE']} {words['SIZE']} {count}"
        raise ValueError(f"{path}: SIZE, TYPE, POINTS: expected F, I or U of known size, found {found}")
    if sorted((name, n) for name, _, _, n in listed if name in AXES) != [("x", 1), ("y", 1), ("z", 1)]:
        raise ValueError(f"{path}: FIELDS, COUNT: expected one x, y and z a point, found {fields} {repeats}")
    if not all(1 <= n <= MAX_REPEAT for n in repeats):
        raise ValueError(f"{path}: COUNT: expected 1 to {MAX_REPEAT} numbers, found {repeats}")
    return np.dtype(
        [
            (name if name in AXES else f"field{i}", "<f8" if is_text else f"<{kind.lower()}{size}", (n,))
            for i, (name, kind, size, n) in enumerate(listed)
        ]
    ), count


def _decompress(path: Path, body: bytes, size: int) -> bytes:
    """Return the `size` bytes that were packed: two lengths and LZF."""
    packed, told = np.frombuffer(body[:8].ljust(8, b"\0"), "<u4").tolist()
    if told != size or packed > len(body) - 8 or size > MAX_LZF_RATIO * packed:
        raise ValueError(f"{path}: body: expected {size} bytes, found {told} from {packed} of {len(body) - 8}")
    plain = np.empty(size, np.uint8)
    if kernels.decompress_lzf(np.frombuffer(body, np.uint8, packed, 8), plain) != size:
        raise ValueError(f"{path}: body: expected {size} bytes after LZF, found others")
    return plain.tobytes()
