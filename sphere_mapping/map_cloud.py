"""The point cloud of a map: the measured points of its key spheres, thinned."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sphere_mapping.params import CloudParams
from sphere_nav.geometry.arrays import Bytes, Floats
from sphere_nav.spheres.graph import SphereGraph
from sphere_nav.spheres.sphere import Sphere


class MapCloud:
    """The thinned points of the newest key spheres, kept in their own frames: only new ones are asked for."""

    def __init__(self, params: CloudParams, load: Callable[[int], Sphere]) -> None:
        self._params, self._load = params, load
        self._parts: dict[int, tuple[Floats, Bytes]] = {}

    def of(self, graph: SphereGraph) -> tuple[Floats, Bytes]:
        """Return points (N, 3) in the map frame in metres and their grey (N,) or RGB (N, 3) values, newest first.

        One grey sphere makes all grey.
        """
        parts, number = dict[int, tuple[Floats, Bytes]](), 0
        for node in sorted(graph, key=lambda node: node.id, reverse=True):
            if number >= self._params.max_points:
                break
            parts[node.id] = self._parts.get(node.id) or thin_points(self._load(node.id), self._params)
            number += len(parts[node.id][0])
        self._parts = parts
        if not parts:
            return np.zeros((0, 3), np.float32), np.zeros(0, np.uint8)
        points_map = [graph[key].T_map_sphere.apply(points).astype(np.float32) for key, (points, _) in parts.items()]
        values = [values for _, values in parts.values()]
        if any(some.ndim == 1 for some in values):
            values = [some if some.ndim == 1 else some[:, 1] for some in values]
        limit = self._params.max_points
        return np.concatenate(points_map)[:limit], np.concatenate(values)[:limit]


def thin_points(sphere: Sphere, params: CloudParams) -> tuple[Floats, Bytes]:
    """Return the thinned points (N, 3) of a sphere in its own frame and their image values."""
    points, values = sphere.points(params.step)
    near = np.linalg.norm(points, axis=1) <= params.max_range_m
    return points[near], values[near]
