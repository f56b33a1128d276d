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


INDICES = ("vertex_indices", "vertex_index")  # the list of a face that tells its corners


@dataclass
class Element:
    """One kind of row: its properties in order: name, type of the count (empty: no list), type of the items."""

    name: str
    count: int
    properties: list[tuple[str, str, str]] = field(default_factory=list)

    @property
    def scalars(self) -> list[tuple[str, str]]:
        """Names and types of what is no list."""
        return [(name, kind) for name, counted, kind in self.properties if not counted]

    @property
    def lists(self) -> list[str]:
        """Names of the lists."""
        return [name for name, counted, _ in self.properties if counted]

    @property
    def is_polygons(self) -> bool:
        """Whether its rows tell the corners of faces, perhaps with other things."""
        return self.name == "face" and bool(self.lists)


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
                elements[-1].properties.append((name, TYPES[count], TYPES[item]))
            case ["property", kind, name] if elements and kind in TYPES:
                elements[-1].properties.append((name, "", TYPES[kind]))
            case ["comment" | "obj_info", *_] | []:
                pass
            case _:
                raise ValueError(f"{path}: header: expected format, element or property, found {line[:60]!r}")
    vertex = next((item for item in elements if item.name == "vertex"), None)
    if order is None or vertex is None or not {"x", "y", "z"} <= {name for name, _ in vertex.scalars} or vertex.lists:
        raise ValueError(f"{path}: header: expected a format and vertices with x, y, z, found {text[:60]!r}")
    for face in elements:
        if face.is_polygons and sum(name in INDICES for name in face.lists) != 1:
            raise ValueError(f"{path}: header: face: expected one list {INDICES[0]}, found {', '.join(face.lists)}")
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
                found.triangles = _fans([_corners(line.split(), item) for line in part])
        except (ValueError, OverflowError) as error:
            raise ValueError(f"{path}: {item.name}: expected {item.count} rows, found {error!s:.60}") from None
    return found


def _binary(path: Path, body: bytes, elements: list[Element], order: str) -> _Rows:
    found, start = _Rows([], np.zeros((0, 3), np.int64)), 0
    for item in elements:
        row = np.dtype([(name, order + (counted or kind)) for name, counted, kind in item.properties])
        smallest = row.itemsize  # lists may be empty
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


def _corners(words: list[bytes], item: Element) -> list[int]:
    """Return the corners of a face by the words of its row."""
    found: list[int] = []
    place = 0
    for name, counted, _ in item.properties:
        length = int(words[place]) if counted and place < len(words) else 1 - bool(counted)
        if not 0 <= length <= MAX_FACE:
            break
        first = place + bool(counted)
        place = first + length
        found = [int(word) for word in words[first:place]] if name in INDICES else found
    if place != len(words):
        raise ValueError("a face with another number of corners than it says")
    return found


def _faces(path: Path, body: bytes, start: int, item: Element, order: str) -> tuple[NDArray[np.int64], int]:
    """Return the triangles of a face element and where it ends; all rows as long as the first is the fast case."""
    if not item.count:
        return _fans([]), start
    first, _ = _face(path, body, start, item, order, 0)
    lengths = [len(values) for values in first]
    kinds = [
        part
        for (name, counted, kind), length in zip(item.properties, lengths, strict=True)
        for part in ([(f"number of {name}", order + counted)] if counted else []) + [(name, order + kind, (length,))]
    ]
    same = np.dtype(kinds)
    names = [name for name, _, _ in item.properties]
    which = next(name for name in names if name in INDICES)
    if len(set(names)) == len(names) and len(body) - start >= item.count * same.itemsize:
        table = np.frombuffer(body, same, item.count, start)
        told = [np.all(table[f"number of {n}"] == lengths[i]) for i, n in enumerate(names) if item.properties[i][1]]
        if all(told) and lengths[names.index(which)] == 3:
            return table[which].astype(np.int64).reshape(-1, 3), start + item.count * same.itemsize
    polygons = []
    for number in range(item.count):
        values, start = _face(path, body, start, item, order, number)
        polygons.append(values[names.index(which)].astype(np.int64).tolist())
    return _fans(polygons), start


def _face(
    path: Path, body: bytes, start: int, item: Element, order: str, number: int
) -> tuple[list[NDArray[np.generic]], int]:
    """Return the values of each property of one face, and where it ends."""
    found: list[NDArray[np.generic]] = []
    for _, counted, kind in item.properties:
        count_type, item_type, n = np.dtype(order + (counted or kind)), np.dtype(order + kind), 1
        if counted:
            n = int(np.frombuffer(body, count_type, 1, start)[0]) if start + count_type.itemsize <= len(body) else -1
            start += count_type.itemsize
        if not 0 <= n <= MAX_FACE or start + n * item_type.itemsize > len(body):
            raise ValueError(f"{path}: face {number}: expected up to {MAX_FACE} corners within the file, found {n}")
        found.append(np.frombuffer(body, item_type, n, start))
        start += n * item_type.itemsize
    return found, start


def _fans(polygons: list[list[int]]) -> NDArray[np.int64]:
    """Return triangles (T, 3) that cover the polygons."""
    fans = [(row[0], row[i], row[i + 1]) for row in polygons for i in range(1, len(row) - 1)]
    return np.array(fans, np.int64).reshape(-1, 3)
