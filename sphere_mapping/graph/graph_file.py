"""A pose graph as g2o text: VERTEX_SE3:QUAT or VERTEX_SE2, and their edges.

Information is written as GTSAM and SE-Sync read it, of translation and rotation vector; g2o's own error is the
quaternion's vector, half the angle.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sphere_mapping.graph.pose_graph import TANGENT_SIZE, PoseGraph
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array


def write_g2o(path: Path, graph: PoseGraph) -> None:
    """Write vertices and edges."""
    kind, numbers = ("SE2", _planar) if graph.dimension == 2 else ("SE3:QUAT", _spatial)
    upper = np.triu_indices(TANGENT_SIZE[graph.dimension])
    lines = [f"VERTEX_{kind} {name} {_text(numbers(T))}" for name, T in zip(graph.ids, graph.poses, strict=True)]
    for (a, b), T, information in zip(graph.ends, graph.motions, graph.information, strict=True):
        lines.append(f"EDGE_{kind} {graph.ids[a]} {graph.ids[b]} {_text(numbers(T))} {_text(information[upper])}")
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


def _planar(T: Array) -> Array:
    return np.array([T[0, 2], T[1, 2], np.arctan2(T[1, 0], T[0, 0])])


def _spatial(T: Array) -> Array:
    return np.concatenate([T[:3, 3], SE3(T).quaternion])


def _text(values: Array) -> str:
    return " ".join(f"{value:.12g}" for value in values)
