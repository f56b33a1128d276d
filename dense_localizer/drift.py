"""How uncertain the way by the map is: what its edges admit adds up along it.

The pose in the map is relative to the map. Whoever takes its poses as odometry asks something else: how far has the
camera come since it was localised? Key spheres err against one another, so that this grows with the way.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dense_localizer.map_error import EDGE
from sphere_geometry import SE3
from sphere_map.graph import SphereGraph

Array = NDArray[np.float64]
MIN_LENGTH_M = 0.1  # of an edge: key spheres that stand closer say nothing of a metre
UNKNOWN = np.repeat([0.002, 0.0015], 3) ** 2  # variance (6,) of a metre, where a map has no edges


class MapDrift:
    """The covariance (6, 6) of xi in T_start_now @ exp(xi) by the errors of the map between both."""

    def __init__(self, graph: SphereGraph | None = None) -> None:
        self.per_metre = edge_variance(graph) if graph is not None else np.zeros(6)
        self.covariance: Array = np.zeros((6, 6))
        self._last: SE3 | None = None

    def start(self, T_map_now: SE3) -> None:
        """Begin anew: nothing has drifted yet."""
        self.covariance, self._last = np.zeros((6, 6)), T_map_now

    def go(self, T_map_now: SE3) -> None:
        """Go on to another pose: what has been wrong turns with the body, and a wrong heading moves what follows."""
        if self._last is not None:
            T_now_before = T_map_now.inverse() @ self._last
            Ad, metres = T_now_before.adjoint(), float(np.linalg.norm(T_now_before.translation))
            self.covariance = Ad @ self.covariance @ Ad.T + np.diag(self.per_metre * metres)
        self._last = T_map_now


def edge_variance(graph: SphereGraph) -> Array:
    """Return the variance (6,) of a metre of the map, the same along all axes: the median over its edges."""
    rates = []
    for edge in graph.edges:
        try:
            variance = EDGE * np.diagonal(np.linalg.inv(edge.information))
        except np.linalg.LinAlgError:
            continue
        a, b = graph[edge.a].T_map_sphere, graph[edge.b].T_map_sphere
        length = max(float(a.distance(b)[0]), MIN_LENGTH_M)
        rates.append([variance[:3].mean() / length, variance[3:].mean() / length])
    return np.repeat(np.median(rates, axis=0), 3) if rates else UNKNOWN
