"""Point Cloud Library .pcd: ascii, binary and binary_compressed (LZF, one field after the other)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mcl_depth.constants import MAX_HEADER, MAX_LZF_RATIO
from mcl_depth.geometry import kernels
from sphere_nav.geometry.files.untrusted import MAX_ARRAY_BYTES, read_bytes

KINDS = {"F": "f", "I": "i", "U": "u"}
WIDTHS = {"F": (4, 8), "I": (1, 2, 4, 8), "U": (1, 2, 4, 8)}


@dataclass(frozen=True)
class _Header:
    fields: tuple[str, ...]
    row: np.dtype  # of one point
    count: int
    data: str
    start: int


def read_pcd(path: Path) -> NDArray[np.float64]:
    """Return points (N, 3)."""
    data = read_bytes(path, "map", MAX_ARRAY_BYTES)
    header = _header(path, data)
    body = data[header.start :]
    match header.data:
        case "ascii":
            return _ascii(path, body, header)
        case "binary":
            table = np.frombuffer(_check(path, body, header), header.row, header.count)
            return np.stack([table[axis].astype(np.float64) for axis in "xyz"], axis=1)
        case _:
            return _decompress(path, body, header)


def _header(path: Path, data: bytes) -> _Header:
    words: dict[str, list[str]] = {}
    start = 0
    while "DATA" not in words:
        end = data.find(b"\n", start, MAX_HEADER)
        if end < 0:
            raise ValueError(f"{path}: header: expected a line DATA, found none")
        line = data[start:end].decode("ascii", "replace").split()
        if line and not line[0].startswith("#"):
            words[line[0]] = line[1:]
        start = end + 1
    try:
        fields, kinds = tuple(words["FIELDS"]), words["TYPE"]
        sizes = [int(word) for word in words["SIZE"]]
        repeats = [int(word) for word in words.get("COUNT", ["1"] * len(fields))]
        count = int(words["POINTS"][0]) if "POINTS" in words else int(words["WIDTH"][0]) * int(words["HEIGHT"][0])
        (form,) = words["DATA"]
    except (KeyError, ValueError, IndexError) as error:
        raise ValueError(f"{path}: header: expected FIELDS, SIZE, TYPE, POINTS and DATA, found {error!s:.80}") from None
    if not {"x", "y", "z"} <= set(fields) or not len(fields) == len(kinds) == len(sizes) == len(repeats):
        raise ValueError(f"{path}: FIELDS: expected x, y, z, each with SIZE and TYPE, found {' '.join(fields)}")
    if form not in ("ascii", "binary", "binary_compressed"):
        raise ValueError(f"{path}: DATA: expected ascii, binary or binary_compressed, found {form}")
    if count < 0 or any(size not in WIDTHS.get(kind, ()) for kind, size in zip(kinds, sizes, strict=True)):
        raise ValueError(f"{path}: SIZE, TYPE, POINTS: expected F, I or U of known size, found {kinds} {sizes} {count}")
    if any(not 1 <= n <= 4096 for n in repeats) or any(repeats[fields.index(axis)] != 1 for axis in "xyz"):
        raise ValueError(f"{path}: COUNT: expected one x, y and z a point, found {repeats}")
    parts = [
        (f"field{i}" if name not in ("x", "y", "z") else name, f"<{KINDS[kinds[i]]}{sizes[i]}", (repeats[i],))
        if repeats[i] > 1
        else (f"field{i}" if name not in ("x", "y", "z") else name, f"<{KINDS[kinds[i]]}{sizes[i]}")
        for i, name in enumerate(fields)
    ]
    return _Header(fields, np.dtype(parts), count, form, start)


def _check(path: Path, body: bytes, header: _Header) -> bytes:
    expected = header.count * header.row.itemsize
    if len(body) < expected:
        raise ValueError(f"{path}: POINTS: expected {header.count} points in {expected} bytes, found {len(body)} bytes")
    return body


def _ascii(path: Path, body: bytes, header: _Header) -> NDArray[np.float64]:
    lines = [line for line in body.splitlines() if line.strip()]
    if len(lines) < header.count:
        raise ValueError(f"{path}: POINTS: expected {header.count} rows, found {len(lines)}")
    columns = [int(np.prod(header.row[i].shape)) for i in range(len(header.fields))]
    where = [sum(columns[: header.fields.index(axis)]) for axis in "xyz"]
    try:
        table = np.array(b" ".join(lines[: header.count]).split(), np.float64).reshape(header.count, sum(columns))
    except ValueError as error:
        raise ValueError(f"{path}: rows: expected {sum(columns)} numbers in each, found {error!s:.80}") from None
    return table[:, where]


def _decompress(path: Path, body: bytes, header: _Header) -> NDArray[np.float64]:
    if len(body) < 8:
        raise ValueError(f"{path}: body: expected two sizes, found {len(body)} bytes")
    packed, size = (int(n) for n in np.frombuffer(body, "<u4", 2))
    expected = header.count * header.row.itemsize
    if size != expected or packed > len(body) - 8 or size > MAX_LZF_RATIO * max(packed, 1):
        found = f"{size} bytes from {packed} of {len(body) - 8}"
        raise ValueError(f"{path}: body: expected {expected} bytes of {header.count} points, found {found}")
    plain = np.empty(size, np.uint8)
    written = kernels.decompress_lzf(np.frombuffer(body, np.uint8, packed, 8), plain)
    if written != size:
        raise ValueError(
            f"{path}: body: expected {size} bytes after LZF, found {written if written >= 0 else 'damage'}"
        )
    columns = []
    for axis in "xyz":
        kind, offset = header.row.fields[axis][:2]  # type: ignore[index]
        columns.append(np.frombuffer(plain, kind, header.count, offset * header.count).astype(np.float64))
    return np.stack(columns, axis=1)
