"""Stanford .ply: points, with or without faces; ascii and binary."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

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


@dataclass
class Element:
    """One kind of row: scalar properties by name, and the list property of faces (types of count and item)."""

    name: str
    count: int
    scalars: list[tuple[str, str]] = field(default_factory=list)
    lists: list[tuple[str, str, str]] = field(default_factory=list)

    @property
    def is_polygons(self) -> bool:
        """Whether its rows are the corners of faces and nothing else."""
        return self.name == "face" and len(self.lists) == 1 and not self.scalars


def read_ply(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return points (N, 3) and triangles (T, 3) of vertex indices, T = 0 without faces; polygons become fans."""
    data = read_bytes(path, "map", MAX_ARRAY_BYTES)
    end = re.search(rb"end_header\r?\n", data[:MAX_HEADER])
    if not data.startswith(b"ply") or end is None:
        raise ValueError(f"{path}: header: expected 'ply' ... 'end_header', found {bytes(data[:16])!r}")
    order, elements = _header(path, data[: end.start()].decode("ascii", "replace"))
    body = data[end.end() :]
    rows = _ascii(path, body, elements) if order == "" else _binary(path, body, elements, order)
    names = [name for name, _ in next(item for item in elements if item.name == "vertex").scalars]
    points = np.stack([rows.points[names.index(axis)] for axis in "xyz"], axis=1)
    return points, rows.triangles


@dataclass
class _Rows:
    points: list[NDArray[np.float64]]  # one array (N,) a property
    triangles: NDArray[np.int64]


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
                elements[-1].lists.append((name, TYPES[count], TYPES[item]))
            case ["property", kind, name] if elements and kind in TYPES:
                elements[-1].scalars.append((name, TYPES[kind]))
            case ["comment" | "obj_info", *_] | []:
                pass
            case _:
                raise ValueError(f"{path}: header: expected format, element or property, found {line[:60]!r}")
    vertex = next((item for item in elements if item.name == "vertex"), None)
    if order is None or vertex is None or not {"x", "y", "z"} <= {name for name, _ in vertex.scalars} or vertex.lists:
        raise ValueError(f"{path}: header: expected a format and vertices with x, y, z, found {text[:60]!r}")
    return order, elements


def _ascii(path: Path, body: bytes, elements: list[Element]) -> _Rows:
    lines = [line for line in body.splitlines() if line.strip()]
    expected = sum(item.count for item in elements)
    if len(lines) < expected:
        raise ValueError(f"{path}: body: expected {expected} rows, found {len(lines)}")
    found, first = _Rows([], np.zeros((0, 3), np.int64)), 0
    for item in elements:
        part = lines[first : first + item.count]
        first += item.count
        try:
            if item.name == "vertex":
                table = np.array(b" ".join(part).split(), np.float64).reshape(item.count, len(item.scalars))
                found.points = list(table.T)
            elif item.is_polygons:
                rows = [[int(word) for word in line.split()] for line in part]
                if any(not row or row[0] != len(row) - 1 or row[0] > MAX_FACE for row in rows):
                    raise ValueError("a face with another number of corners than it says")
                found.triangles = _fans([row[1:] for row in rows])
        except (ValueError, OverflowError) as error:
            raise ValueError(f"{path}: {item.name}: expected {item.count} rows, found {error!s:.60}") from None
    return found


def _binary(path: Path, body: bytes, elements: list[Element], order: str) -> _Rows:
    found, start = _Rows([], np.zeros((0, 3), np.int64)), 0
    for item in elements:
        row = np.dtype([(name, order + kind) for name, kind in item.scalars])
        smallest = row.itemsize + sum(np.dtype(count).itemsize for _, count, _ in item.lists)
        if len(body) - start < item.count * smallest:
            raise ValueError(
                f"{path}: {item.name}: expected {item.count} rows of {smallest} bytes, found {len(body) - start} bytes"
            )
        if item.lists:
            if item.is_polygons:
                found.triangles, start = _faces(path, body, start, item, order)
                continue
            break  # rows of unknown length, nothing that is needed here
        if item.name == "vertex":
            table = np.frombuffer(body, row, item.count, start)
            found.points = [table[name].astype(np.float64) for name, _ in item.scalars]
        start += item.count * row.itemsize
    if not found.points:
        raise ValueError(f"{path}: header: expected vertices before elements with lists, found {elements[0].name}")
    return found


def _faces(path: Path, body: bytes, start: int, item: Element, order: str) -> tuple[NDArray[np.int64], int]:
    """Return the triangles of a face element and where it ends; all triangles is the common, fast case."""
    _, count_kind, index_kind = item.lists[0]
    same = np.dtype([("n", order + count_kind), ("i", order + index_kind, 3)])
    if len(body) - start >= item.count * same.itemsize:
        table = np.frombuffer(body, same, item.count, start)
        if np.all(table["n"] == 3):
            return table["i"].astype(np.int64).reshape(-1, 3), start + item.count * same.itemsize
    count_type, index_type = np.dtype(order + count_kind), np.dtype(order + index_kind)
    polygons = []
    for number in range(item.count):
        n = int(np.frombuffer(body, count_type, 1, start)[0]) if start + count_type.itemsize <= len(body) else -1
        start += count_type.itemsize
        if not 0 <= n <= MAX_FACE or start + n * index_type.itemsize > len(body):
            raise ValueError(f"{path}: face {number}: expected up to {MAX_FACE} corners within the file, found {n}")
        polygons.append(np.frombuffer(body, index_type, n, start).astype(np.int64).tolist())
        start += n * index_type.itemsize
    return _fans(polygons), start


def _fans(polygons: list[list[int]]) -> NDArray[np.int64]:
    """Return triangles (T, 3) that cover the polygons."""
    fans = [(row[0], row[i], row[i + 1]) for row in polygons for i in range(1, len(row) - 1)]
    return np.array(fans, np.int64).reshape(-1, 3)
