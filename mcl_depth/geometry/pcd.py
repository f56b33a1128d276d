"""Point Cloud Library .pcd: ascii, binary and binary_compressed (LZF, one field after the other)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mcl_depth.constants import MAX_HEADER, MAX_LZF_RATIO
from mcl_depth.geometry import kernels
from mcl_depth.geometry.ply import floats_of_text, points_of
from sphere_nav.geometry.files.untrusted import MAX_ARRAY_BYTES, read_bytes

TYPES = {"F4", "F8", "I1", "I2", "I4", "I8", "U1", "U2", "U4", "U8"}


@dataclass(frozen=True)
class _Header:
    row: np.dtype  # of one point
    count: int
    form: str
    start: int


def read_pcd(path: Path) -> NDArray[np.float64]:
    """Return points (N, 3)."""
    data = read_bytes(path, "map", MAX_ARRAY_BYTES)
    header = _header(path, data)
    body, size = data[header.start :], header.count * header.row.itemsize
    if header.form == "ascii":
        body = floats_of_text(path, body)
    elif header.form == "binary_compressed":
        body = _decompress(path, body, size)
    if len(body) < size:
        raise ValueError(f"{path}: POINTS: expected {header.count} points in {size} bytes, found {len(body)} bytes")
    if header.form != "binary_compressed":
        return points_of(np.frombuffer(body, header.row, header.count))
    columns = {}
    for axis in "xyz":
        kind, offset = header.row.fields[axis][:2]  # type: ignore[index]
        columns[axis] = np.frombuffer(body, kind, header.count, offset * header.count)
    return points_of(columns)


def _header(path: Path, data: bytes) -> _Header:
    words: dict[str, list[str]] = {}
    start = 0
    while "DATA" not in words:
        end = data.find(b"\n", start, MAX_HEADER)
        if end < 0:
            raise ValueError(f"{path}: header: expected a line DATA, found none")
        name, *rest = data[start:end].decode("ascii", "replace").split() or [""]
        words[name] = rest
        start = end + 1
    try:
        fields, types = words["FIELDS"], words["TYPE"]
        kinds = [kind + size for kind, size in zip(types, words["SIZE"], strict=True)]
        repeats = [int(word) for word in words.get("COUNT", ["1"] * len(fields))]
        count = int(words["POINTS"][0]) if "POINTS" in words else int(words["WIDTH"][0]) * int(words["HEIGHT"][0])
        (form,) = words["DATA"]
    except (KeyError, ValueError, IndexError) as error:
        raise ValueError(f"{path}: header: expected FIELDS, SIZE, TYPE, POINTS and DATA, found {error!s:.80}") from None
    if not {"x", "y", "z"} <= set(fields) or not len(fields) == len(kinds) == len(repeats):
        raise ValueError(f"{path}: FIELDS: expected x, y, z, each with SIZE and TYPE, found {' '.join(fields)}")
    if form not in ("ascii", "binary", "binary_compressed"):
        raise ValueError(f"{path}: DATA: expected ascii, binary or binary_compressed, found {form}")
    if count < 0 or not set(kinds) <= TYPES:
        raise ValueError(f"{path}: SIZE, TYPE, POINTS: expected F, I or U of known size, found {kinds} {count}")
    if any(not 1 <= n <= 4096 for n in repeats) or any(repeats[fields.index(axis)] != 1 for axis in "xyz"):
        raise ValueError(f"{path}: COUNT: expected one x, y and z a point, found {repeats}")
    parts = []
    for i, (name, kind, repeat) in enumerate(zip(fields, kinds, repeats, strict=True)):
        is_needed = name in ("x", "y", "z")
        own = "<f8" if form == "ascii" else f"<{kind.lower()}"
        parts.append((name, own) if is_needed else (f"field{i}", own, (repeat,)))
    return _Header(np.dtype(parts), count, form, start)


def _decompress(path: Path, body: bytes, expected: int) -> bytes:
    if len(body) < 8:
        raise ValueError(f"{path}: body: expected two sizes, found {len(body)} bytes")
    packed, size = (int(n) for n in np.frombuffer(body, "<u4", 2))
    if size != expected or packed > len(body) - 8 or size > MAX_LZF_RATIO * max(packed, 1):
        found = f"{size} bytes from {packed} of {len(body) - 8}"
        raise ValueError(f"{path}: body: expected {expected} bytes, found {found}")
    plain = np.empty(size, np.uint8)
    written = kernels.decompress_lzf(np.frombuffer(body, np.uint8, packed, 8), plain)
    if written != size:
        raise ValueError(
            f"{path}: body: expected {size} bytes after LZF, found {written if written >= 0 else 'damage'}"
        )
    return plain.tobytes()
