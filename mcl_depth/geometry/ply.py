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
                polygons = (np.array([_corners(line.split(), item)], np.int64) for line in part)
                found.triangles = np.concatenate([found.triangles, *map(_fans, polygons)])
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
        count_type, item_type, n = np.dtype(order + (counted or kind)), np.dtype(order + kind), 1
        if counted:
            n = int(np.frombuffer(body, count_type, 1, start)[0]) if start + count_type.itemsize <= len(body) else -1
            kinds.append((f"n{i}", count_type))
            start += count_type.itemsize
        if not 0 <= n <= MAX_FACE or start + n * item_type.itemsize > len(body):
            raise ValueError(f"{path}: face {number}: expected up to {MAX_FACE} corners within the file, found {n}")
        kinds.append((f"v{i}", item_type, (n,)))
        start += n * item_type.itemsize
    return np.dtype(kinds)


def _fans(polygons: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return triangles (T, 3) that cover polygons (N, k)."""
    first = polygons[:, :1].repeat(max(polygons.shape[1] - 2, 0), axis=1)
    return np.stack([first, polygons[:, 1:-1], polygons[:, 2:]], axis=-1).reshape(-1, 3)
