"""Stanford .ply: points, with or without faces. Text is read as a binary file of float64 would be.

trimesh reads them, too, but no binary file with polygons of several sizes (as Blender writes), text that is cut short
as if it were whole, and text of a million points in 5.9 s and 545 MB where this takes 1.4 s and 254 MB.
"""

from __future__ import annotations

import re
import struct
from array import array
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mcl_depth.constants import MAX_FACE, MAX_HEADER
from sphere_nav.geometry.files.untrusted import MAX_ARRAY_BYTES, read_bytes

TYPES = {  # those of struct, which NumPy has, too
    "char": "b", "int8": "b", "uchar": "B", "uint8": "B", "short": "h", "int16": "h", "ushort": "H", "uint16": "H",
    "int": "i", "int32": "i", "uint": "I", "uint32": "I", "float": "f", "float32": "f", "double": "d", "float64": "d",
}  # fmt: skip
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
INDICES = ("vertex_indices", "vertex_index")  # the list of a face that tells its corners


class Element(NamedTuple):
    """One kind of row: its properties in order: name, type of the count (empty: no list), type of the items."""

    name: str
    number: int
    properties: list[tuple[str, str, str]]

    @property
    def lists(self) -> list[str]:
        """Names of the lists."""
        return [name for name, counted, _ in self.properties if counted]


def read_ply(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return points (N, 3) and triangles (T, 3) of vertex indices, T = 0 without faces; polygons become fans."""
    data = read_bytes(path, "map", MAX_ARRAY_BYTES)
    head = re.match(rb"ply\s.*?end_header\r?\n", data[:MAX_HEADER], re.DOTALL)
    if head is None:
        raise ValueError(f"{path}: header: expected 'ply' ... 'end_header', found {bytes(data[:16])!r}")
    order, elements = _header(path, head[0].decode("ascii", "replace"))
    body, start = data[head.end() :], 0
    if not order:
        body = floats_of_text(path, body)
    points, triangles = np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    for item in elements:
        if item.name == "face" and item.lists:
            triangles, start = _faces(path, body, start, item, order)
            continue
        if item.lists:
            break  # rows of unknown length, nothing that is needed here
        row = np.dtype([(name, order + kind if order else "f8") for name, _, kind in item.properties])
        table = rows_of(f"{path}: {item.name}", body, row, item.number, start)
        start += table.nbytes
        if item.name == "vertex":
            points = points_of(table)
    else:
        if not order and start < len(body):
            raise ValueError(f"{path}: body: expected {start // 8} numbers, found {len(body) // 8}")
    if not len(points):
        raise ValueError(f"{path}: header: expected vertices before elements with lists, found {elements[0].name}")
    return points, triangles


def rows_of(where: str, body: bytes, row: np.dtype, count: int, start: int = 0) -> Any:
    """Return so many rows from `start` on; ValueError where there are fewer."""
    if len(body) - start < count * row.itemsize:
        raise ValueError(f"{where}: expected {count} rows of {row.itemsize} bytes, found {len(body) - start} bytes")
    return np.frombuffer(body, row, count, start)


def points_of(table: Any) -> NDArray[np.float64]:
    """Return the points (N, 3) of a table with the columns x, y, z."""
    return np.stack([table[axis].ravel().astype(np.float64) for axis in "xyz"], axis=1)


def floats_of_text(path: Path, body: bytes) -> bytes:
    """Return what numbers written as text would be in a binary file of float64."""
    try:
        return np.array(body.split(), np.float64).tobytes()
    except ValueError as error:
        raise ValueError(f"{path}: body: expected numbers, found {error!s:.60}") from None


def _header(path: Path, text: str) -> tuple[str, list[Element]]:
    elements: list[Element] = []
    order = None
    for line in text.splitlines()[1:-1]:
        match line.split():
            case ["format", name, *_] if name in ORDERS:
                order = ORDERS[name]
            case ["element", name, count] if count.isdecimal():
                elements.append(Element(name, int(count), []))
            case ["property", "list", count, item, name] if elements and count in TYPES and item in TYPES:
                elements[-1].properties.append((name, TYPES[count], TYPES[item]))
            case ["property", kind, name] if elements and kind in TYPES:
                elements[-1].properties.append((name, "", TYPES[kind]))
            case ["comment" | "obj_info", *_] | []:
                pass
            case _:
                raise ValueError(f"{path}: header: expected format, element or property, found {line[:60]!r}")
    vertex = next((item for item in elements if item.name == "vertex"), Element("", 0, []))
    if order is None or vertex.lists or not {"x", "y", "z"} <= {name for name, _, _ in vertex.properties}:
        raise ValueError(f"{path}: header: expected a format and vertices with x, y, z, found {text[:60]!r}")
    return order, elements


def _faces(path: Path, body: bytes, start: int, item: Element, order: str) -> tuple[NDArray[np.int64], int]:
    """Return the triangles of a face element whose rows begin at `start`, and where they end."""
    if len([name for name in item.lists if name in INDICES]) != 1:
        raise ValueError(f"{path}: header: face: expected one list {INDICES[0]}, found {', '.join(item.lists)}")
    if order and len(item.properties) == 1 and np.dtype(item.properties[0][2]).kind in "iu":
        _, counted, kind = item.properties[0]
        layout = np.dtype([("count", order + counted), ("corners", order + kind, 3)])
        rows = np.frombuffer(body, layout, min(item.number, (len(body) - start) // layout.itemsize), start)
        if len(rows) == item.number and (rows["count"] == 3).all():  # as most are; others take seconds a million
            return rows["corners"].astype(np.int64), start + rows.nbytes
    triangles = array("q")

    def unpack(kind: str, count: int) -> tuple[float, ...]:
        """Return the next numbers, which are float64 of a text."""
        nonlocal start
        numbers = f"{order or '<'}{count}{kind if order else 'd'}"
        values = struct.unpack_from(numbers, body, start)
        start += struct.calcsize(numbers)
        return values

    for row in range(item.number):
        try:
            for name, counted, kind in item.properties:
                count = int(unpack(counted, 1)[0]) if counted else 1
                if not 0 <= count <= MAX_FACE:
                    raise ValueError
                values = unpack(kind, count)
                if name in INDICES:
                    corners = [*map(int, values)]
                    for pair in pairwise(corners[1:]):
                        triangles.extend((corners[0], *pair))
        except (struct.error, ValueError, OverflowError):
            expected = f"expected up to {MAX_FACE} corners within the file"
            raise ValueError(f"{path}: face {row}: {expected}, found others") from None
    return np.array(triangles, np.int64).reshape(-1, 3), start
