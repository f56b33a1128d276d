"""Stanford .ply: points, with or without faces. Text is read as a binary file of float64 would be."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mcl_depth.constants import MAX_FACE, MAX_HEADER
from sphere_nav.geometry.files.untrusted import MAX_ARRAY_BYTES, read_bytes

TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
INDICES = ("vertex_indices", "vertex_index")  # the list of a face that tells its corners


@dataclass
class Element:
    """One kind of row: its properties in order: name, type of the count (empty: no list), type of the items."""

    name: str
    count: int
    properties: list[tuple[str, str, str]] = field(default_factory=list)

    @property
    def lists(self) -> list[str]:
        """Names of the lists."""
        return [name for name, counted, _ in self.properties if counted]


def read_ply(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return points (N, 3) and triangles (T, 3) of vertex indices, T = 0 without faces; polygons become fans."""
    data = read_bytes(path, "map", MAX_ARRAY_BYTES)
    end = re.search(rb"end_header\r?\n", data[:MAX_HEADER])
    if not data.startswith(b"ply") or end is None:
        raise ValueError(f"{path}: header: expected 'ply' ... 'end_header', found {bytes(data[:16])!r}")
    order, elements = _header(path, data[: end.start()].decode("ascii", "replace"))
    body, start = data[end.end() :], 0
    if not order:
        body = floats_of_text(path, body)
    points, triangles = np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    for item in elements:
        if item.name == "face" and item.lists:
            triangles, start = _faces(path, body, start, item, order)
            continue
        if item.lists:
            break  # rows of unknown length, nothing that is needed here
        row = np.dtype([(name, _kind(order, kind)) for name, _, kind in item.properties])
        if len(body) - start < item.count * row.itemsize:
            found = f"found {len(body) - start} bytes"
            raise ValueError(f"{path}: {item.name}: expected {item.count} rows of {row.itemsize} bytes, {found}")
        if item.name == "vertex":
            points = points_of(np.frombuffer(body, row, item.count, start))
        start += item.count * row.itemsize
    else:
        if not order and start < len(body):
            raise ValueError(f"{path}: body: expected {start // 8} numbers, found {len(body) // 8}")
    if not len(points):
        raise ValueError(f"{path}: header: expected vertices before elements with lists, found {elements[0].name}")
    return points, triangles


def points_of(table: Any) -> NDArray[np.float64]:
    """Return the points (N, 3) of a table with the columns x, y, z."""
    return np.stack([table[axis].ravel().astype(np.float64) for axis in "xyz"], axis=1)


def floats_of_text(path: Path, body: bytes) -> bytes:
    """Return what numbers written as text would be in a binary file of float64."""
    try:
        return np.array(body.split(), np.float64).tobytes()
    except ValueError as error:
        raise ValueError(f"{path}: body: expected numbers, found {error!s:.60}") from None


def _kind(order: str, kind: str) -> str:
    """Return the type of a number in the body: as the header has it, or float64 where that was text."""
    return order + kind if order else "f8"


def _header(path: Path, text: str) -> tuple[str, list[Element]]:
    elements: list[Element] = []
    order = None
    for line in text.splitlines()[1:]:
        match line.split():
            case ["format", name, *_] if name in ORDERS:
                order = ORDERS[name]
            case ["element", name, count] if count.isdigit():
                elements.append(Element(name, int(count)))
            case ["property", "list", count, item, name] if elements and count in TYPES and item in TYPES:
                elements[-1].properties.append((name, TYPES[count], TYPES[item]))
            case ["property", kind, name] if elements and kind in TYPES:
                elements[-1].properties.append((name, "", TYPES[kind]))
            case ["comment" | "obj_info", *_] | []:
                pass
            case _:
                raise ValueError(f"{path}: header: expected format, element or property, found {line[:60]!r}")
    vertex = next((item for item in elements if item.name == "vertex"), Element("", 0))
    if order is None or vertex.lists or not {"x", "y", "z"} <= {name for name, _, _ in vertex.properties}:
        raise ValueError(f"{path}: header: expected a format and vertices with x, y, z, found {text[:60]!r}")
    for face in elements:
        if face.name == "face" and face.lists and sum(name in INDICES for name in face.lists) != 1:
            raise ValueError(f"{path}: header: face: expected one list {INDICES[0]}, found {', '.join(face.lists)}")
    return order, elements


def _faces(path: Path, body: bytes, start: int, item: Element, order: str) -> tuple[NDArray[np.int64], int]:
    """Return the triangles of a face element and where it ends; rows as long as the one before are read at once."""
    lists = [i for i, (_, counted, _) in enumerate(item.properties) if counted]
    which = next(i for i in lists if item.properties[i][0] in INDICES)
    triangles, number, most = [np.zeros((0, 3), np.int64)], 0, 1
    while number < item.count:
        row = _row_of(path, body, start, item, order, number)
        table = np.frombuffer(body, row, min(item.count - number, most, (len(body) - start) // row.itemsize), start)
        is_same = np.all([table[f"n{i}"] == table[f"n{i}"][0] for i in lists], axis=0)
        run = len(table) if is_same.all() else int(np.argmin(is_same))
        triangles.append(_fans(table[f"v{which}"][:run].astype(np.int64)))
        number, start, most = number + run, start + run * row.itemsize, 2 * run
    return np.concatenate(triangles), start


def _row_of(path: Path, body: bytes, start: int, item: Element, order: str, number: int) -> np.dtype:
    """Return what one face looks like: n0, n1, ... are the lengths of its lists, v0, v1, ... the values."""
    kinds: list[tuple] = []
    for i, (_, counted, kind) in enumerate(item.properties):
        count_type, item_type, n = np.dtype(_kind(order, counted or kind)), np.dtype(_kind(order, kind)), 1.0
        if counted:
            n = float(np.frombuffer(body, count_type, 1, start)[0]) if start + count_type.itemsize <= len(body) else -1
            kinds.append((f"n{i}", count_type))
            start += count_type.itemsize
        if not 0 <= n <= MAX_FACE or start + n * item_type.itemsize > len(body):
            raise ValueError(f"{path}: face {number}: expected up to {MAX_FACE} corners within the file, found {n:g}")
        kinds.append((f"v{i}", item_type, (int(n),)))
        start += int(n) * item_type.itemsize
    return np.dtype(kinds)


def _fans(polygons: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return triangles (T, 3) that cover polygons (N, k)."""
    first = polygons[:, :1].repeat(max(polygons.shape[1] - 2, 0), axis=1)
    return np.stack([first, polygons[:, 1:-1], polygons[:, 2:]], axis=-1).reshape(-1, 3)
