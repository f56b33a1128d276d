"""A map's graph as g2o text: VERTEX_SE3:QUAT and the edges."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.spheres.graph import SphereGraph


def write_g2o(path: Path, graph: SphereGraph) -> None:
    """Write vertices and edges."""
    upper = np.triu_indices(6)
    lines = [f"VERTEX_SE3:QUAT {node.id} {_pose(node.T_map_sphere)}" for node in graph]
    for edge in graph.edges:
        lines.append(f"EDGE_SE3:QUAT {edge.a} {edge.b} {_pose(edge.T_a_b)} {_text(edge.information[upper])}")
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


def _pose(T: SE3) -> str:
    return _text(np.concatenate([T.translation, T.quaternion]))


def _text(values: Array) -> str:
    return " ".join(f"{value:.12g}" for value in values)
