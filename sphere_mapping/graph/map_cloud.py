"""The point cloud of a map: the measured points of its key spheres, thinned."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sphere_map.graph import KeySphere, SphereGraph
from sphere_map.sphere import Image
from sphere_mapping.params import CloudParams

Points = NDArray[np.float32]


def cloud_of(graph: SphereGraph, params: CloudParams | None = None) -> tuple[Points, Image]:
    """Return points (N, 3) in the map frame in metres and their grey (N,) or RGB (N, 3) values, newest spheres first.

    Only spheres in memory count; one grey sphere makes all grey.
    """
    params = params or CloudParams()
    parts: list[tuple[Points, Image]] = []
    for node in sorted(graph, key=lambda node: node.id, reverse=True):
        if node.sphere is not None and sum(len(points) for points, _ in parts) < params.max_points:
            parts.append(points_of(node, params))
    if not parts:
        return np.zeros((0, 3), np.float32), np.zeros(0, np.uint8)
    if any(values.ndim == 1 for _, values in parts):
        parts = [(points, values if values.ndim == 1 else values[:, 1]) for points, values in parts]
    points, values = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    return points[: params.max_points], values[: params.max_points]


def points_of(node: KeySphere, params: CloudParams) -> tuple[Points, Image]:
    """Return the thinned points (N, 3) of one key sphere in the map frame and their image values."""
    if node.sphere is None:
        raise ValueError(f"key sphere {node.id}: expected its picture in memory, found none")
    points, values = node.sphere.points(params.step)
    near = np.linalg.norm(points, axis=1) <= params.max_range_m
    return node.T_map_sphere.apply(points[near]).astype(np.float32), values[near]
