"""Published pose graphs: g2o files (VERTEX_SE2, VERTEX_SE3:QUAT and their edges).

Information is read as GTSAM and SE-Sync read it, of translation and rotation vector, so that chi2 compares with
published figures; g2o's own error is the quaternion's vector, half the angle.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sphere_mapping.graph.pose_graph import TANGENT_SIZE, PoseGraph
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array


def read_graph(path: Path) -> PoseGraph:
    """Return the graph of a file."""
    poses: dict[int, Array] = {}
    edges: list[tuple[int, int, Array, Array]] = []
    for line in path.read_text(encoding="ascii").splitlines():
        kind, _, values = line.partition(" ")
        numbers = [float(word) for word in values.split()]
        num_pose = 3 if kind.endswith("SE2") else 7
        if kind.startswith("VERTEX"):
            poses[int(numbers[0])] = _pose(np.array(numbers[1:]))
        elif kind.startswith("EDGE"):
            motion, information = np.array(numbers[2 : 2 + num_pose]), np.array(numbers[2 + num_pose :])
            edges.append((int(numbers[0]), int(numbers[1]), _pose(motion), _symmetric(information, num_pose)))
    ids = sorted(poses)
    row = {name: k for k, name in enumerate(ids)}
    return PoseGraph(
        np.array(ids, dtype=np.int64),
        np.array([poses[name] for name in ids]),
        np.array([(row[a], row[b]) for a, b, _, _ in edges], dtype=np.int64),
        np.array([motion for _, _, motion, _ in edges]),
        np.array([information for _, _, _, information in edges]),
        np.zeros(len(edges), dtype=np.bool_),
    )


def _pose(values: Array) -> Array:
    if len(values) == 7:
        return SE3.from_quaternion(values[3:], values[:3]).matrix
    x, y, angle = values
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, -sine, x], [sine, cosine, y], [0.0, 0.0, 1.0]])


def _symmetric(upper: Array, num_pose: int) -> Array:
    size = TANGENT_SIZE[2 if num_pose == 3 else 3]
    information = np.zeros((size, size))
    information[np.triu_indices(size)] = upper
    return information + np.triu(information, 1).T
