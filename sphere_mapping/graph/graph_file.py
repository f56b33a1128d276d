"""Pose graphs as text: g2o (VERTEX_SE2, VERTEX_SE3:QUAT and their edges) and TORO (VERTEX2, VERTEX3 and theirs).

Information is read as GTSAM and SE-Sync read it, of translation and rotation vector, so that chi2 compares with
published figures, and written so; g2o's own error is the quaternion's vector, half the angle. FIX names a vertex
that stays.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sphere_mapping.graph.chordal import spanning_poses
from sphere_mapping.graph.pose_graph import TANGENT_SIZE, PoseGraph
from sphere_nav.geometry import SE3, so3
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.files.limits import LIMITS
from sphere_nav.geometry.files.untrusted import open_file

SINGULAR = 1e-12  # smallest by largest eigenvalue: what rounding leaves of 0
IGNORED = ("PARAMS_", "EQUIV", "#")
TORO_PLANE = ((0, 0), (0, 1), (1, 1), (2, 2), (0, 2), (1, 2))  # TORO's order in the plane, not row by row


class GraphFile(NamedTuple):
    """A graph, and the edges left out of it as lines of text: file, line, ids, what is wrong."""

    graph: PoseGraph
    left_out: tuple[str, ...]


class LineFormat(NamedTuple):
    """How a kind of line gives a pose: the dimension, how many numbers, how to read them, order of the information."""

    dimension: int
    num_pose: int
    to_pose: Callable[[Array], Array]
    information: tuple[tuple[int, int], ...]


@dataclass
class _Lines:
    """What was read so far; dimension 0 until the first pose."""

    dimension: int = 0
    poses: dict[int, Array] = field(default_factory=dict)
    ends: list[tuple[int, int]] = field(default_factory=list)
    motions: list[Array] = field(default_factory=list)
    information: list[Array] = field(default_factory=list)
    places: list[str] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)
    unusable: list[str] = field(default_factory=list)  # what is wrong with the information of an edge
    fixed: dict[int, str] = field(default_factory=dict)  # vertex -> file and line


def read_graph(path: Path) -> PoseGraph:
    """Return the graph of a file; poses chained along its edges where it has no vertices. ValueError by line."""
    return read_graph_file(path, is_leaving_out=False).graph


def read_graph_file(path: Path, *, is_leaving_out: bool) -> GraphFile:
    """Return the graph of a file, without edges of indefinite or singular information if `is_leaving_out`."""
    found = _Lines()
    with open_file(path, "g2o or TORO file", LIMITS["pose graph"]) as opened:
        for number, line in enumerate(io.TextIOWrapper(opened, encoding="ascii", errors="replace"), 1):
            try:
                _read_line(line.split(), f"{path}:{number}", number, found)
            except ValueError as error:
                raise ValueError(f"{path}:{number}: {error}") from None
    if not found.ends and not (found.unusable and not is_leaving_out):
        raise ValueError(f"{path}: expected edges (EDGE_SE3:QUAT, EDGE_SE2, EDGE3 or EDGE2), found none")
    if found.unusable and not is_leaving_out:
        more = f" (and {len(found.unusable) - 1} more edges)" if len(found.unusable) > 1 else ""
        raise ValueError(found.unusable[0] + more)
    return GraphFile(_assemble(found), tuple(found.unusable))


def write_g2o(path: Path, graph: PoseGraph) -> None:
    """Write vertices and edges."""
    kind, numbers = ("SE2", _planar) if graph.dimension == 2 else ("SE3:QUAT", _spatial)
    upper = np.triu_indices(TANGENT_SIZE[graph.dimension])
    lines = [f"VERTEX_{kind} {name} {_text(numbers(T))}" for name, T in zip(graph.ids, graph.poses, strict=True)]
    lines += [f"FIX {graph.ids[row]}" for row in graph.fixed]
    for (a, b), T, information in zip(graph.ends, graph.motions, graph.information, strict=True):
        lines.append(f"EDGE_{kind} {graph.ids[a]} {graph.ids[b]} {_text(numbers(T))} {_text(information[upper])}")
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


def _read_line(words: list[str], place: str, line: int, found: _Lines) -> None:
    if not words or words[0].startswith(IGNORED):
        return
    if words[0] == "FIX":
        found.fixed |= dict.fromkeys(map(_id, words[1:]), place)
        return
    kind, _, name = words[0].partition("_") if "_" in words[0] else (words[0][:-1], "", words[0][-1:])
    layout = LAYOUTS.get(name)
    if layout is None or kind not in ("VERTEX", "EDGE"):
        raise ValueError(f"expected VERTEX or EDGE of {', '.join(LAYOUTS)}, found {words[0][:40]}")
    if found.dimension not in (0, layout.dimension):
        raise ValueError(f"expected poses of {found.dimension} dimensions as before, found {words[0]}")
    found.dimension = layout.dimension
    num_ends = 1 if kind == "VERTEX" else 2
    num_values = layout.num_pose + (len(layout.information) if kind == "EDGE" else 0)
    if len(words) != 1 + num_ends + num_values:
        raise ValueError(f"{words[0]}: expected {num_ends + num_values} numbers, found {len(words) - 1}")
    ends = tuple(_id(word) for word in words[1 : 1 + num_ends])
    values = np.array([float(word) for word in words[1 + num_ends :]])
    if not np.all(np.isfinite(values)):
        raise ValueError(f"{words[0]}: expected finite numbers, found {words[1 + num_ends :]}")
    pose = layout.to_pose(values[: layout.num_pose])
    if kind == "VERTEX":
        if ends[0] in found.poses:
            raise ValueError(f"expected every vertex once, found {ends[0]} again")
        found.poses[ends[0]] = pose
        return
    if ends[0] == ends[1]:
        raise ValueError(f"expected an edge between two vertices, found {ends[0]} twice")
    information = _information(values[layout.num_pose :], layout)
    lowest, *_, highest = np.linalg.eigvalsh(information)
    if lowest <= SINGULAR * abs(highest):
        expected = "expected a positive definite information matrix"
        found.unusable.append(f"{place}: edge {ends[0]} {ends[1]}: {expected}, found an eigenvalue of {lowest:.3g}")
        return
    found.ends.append((ends[0], ends[1]))
    found.motions.append(pose)
    found.information.append(information)
    found.places.append(place)
    found.lines.append(line)


def _assemble(found: _Lines) -> PoseGraph:
    ids = sorted(found.poses or {end for ends in found.ends for end in ends})
    row = {name: k for k, name in enumerate(ids)}
    for ends, place in zip(found.ends, found.places, strict=True):
        for end in ends:
            if end not in row:
                raise ValueError(f"{place}: expected an edge between vertices of the file, found no vertex {end}")
    for name, place in found.fixed.items():
        if name not in row:
            raise ValueError(f"{place}: FIX: expected a vertex of the file, found no vertex {name}")
    size = found.dimension + 1
    graph = PoseGraph(
        np.array(ids, dtype=np.int64),
        np.array([found.poses[name] for name in ids]) if found.poses else np.tile(np.eye(size), (len(ids), 1, 1)),
        np.array([(row[a], row[b]) for a, b in found.ends], dtype=np.int64),
        np.array(found.motions),
        np.array(found.information),
        np.zeros(len(found.ends), dtype=np.bool_),
        tuple(sorted(row[name] for name in found.fixed)),
        np.array(found.lines, dtype=np.int64),
    )
    return graph if found.poses else replace(graph, poses=spanning_poses(graph))


def _id(word: str) -> int:
    if not word.isdigit() or int(word) >= 1 << 63:
        raise ValueError(f"expected the number of a vertex, found {word[:40]!r}")
    return int(word)


def _information(values: Array, layout: LineFormat) -> Array:
    size = TANGENT_SIZE[layout.dimension]
    information = np.zeros((size, size))
    for (i, j), value in zip(layout.information, values, strict=True):
        information[i, j] = information[j, i] = value
    return information


def _from_planar(values: Array) -> Array:
    x, y, angle = values
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, -sine, x], [sine, cosine, y], [0.0, 0.0, 1.0]])


def _from_euler(values: Array) -> Array:
    """Read x y z roll pitch yaw: turned by yaw about z, then pitch about the new y, then roll about the new x."""
    roll, pitch, yaw = np.eye(3) * values[3:, None]
    return SE3.from_parts(so3.exp(yaw) @ so3.exp(pitch) @ so3.exp(roll), values[:3]).matrix


def _planar(T: Array) -> Array:
    return np.array([T[0, 2], T[1, 2], np.arctan2(T[1, 0], T[0, 0])])


def _spatial(T: Array) -> Array:
    return np.concatenate([T[:3, 3], SE3(T).quaternion])


def _text(values: Array) -> str:
    return " ".join(f"{value:.12g}" for value in values)


def _upper(size: int) -> tuple[tuple[int, int], ...]:
    return tuple((i, j) for i in range(size) for j in range(i, size))


LAYOUTS = {
    "SE2": LineFormat(2, 3, _from_planar, _upper(3)),
    "SE3:QUAT": LineFormat(3, 7, lambda values: SE3.from_quaternion(values[3:], values[:3]).matrix, _upper(6)),
    "2": LineFormat(2, 3, _from_planar, TORO_PLANE),
    "3": LineFormat(3, 6, _from_euler, _upper(6)),
}
