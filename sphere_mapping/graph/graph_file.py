"""A pose graph as g2o text: VERTEX_SE3:QUAT and the edges.

Information is written as GTSAM and SE-Sync read it, of translation and rotation vector; g2o's own error is the
quaternion's vector, half the angle.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sphere_mapping.graph.pose_graph import PoseGraph
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array


def write_g2o(path: Path, graph: PoseGraph) -> None:
    """Write vertices and edges."""
    upper = np.triu_indices(6)
    lines = [f"VERTEX_SE3:QUAT {name} {_text(_numbers(T))}" for name, T in zip(graph.ids, graph.poses, strict=True)]
    for (a, b), T, information in zip(graph.ends, graph.motions, graph.information, strict=True):
        ends = f"{graph.ids[a]} {graph.ids[b]}"
        lines.append(f"EDGE_SE3:QUAT {ends} {_text(_numbers(T))} {_text(information[upper])}")
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


def _numbers(T: Array) -> Array:
    return np.concatenate([T[:3, 3], SE3(T).quaternion])


def _text(values: Array) -> str:
    return " ".join(f"{value:.12g}" for value in values)
