"""The ground of a map as a picture from above, of what its key spheres saw below themselves."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry.arrays import Array, Bytes
from sphere_nav.ros.maps.reader import open_map

CELL_M, MAX_CELLS = 0.05, 2000  # of the picture; a larger map has larger cells
REACH_M, BELOW_M = 12.0, 0.2  # around a key sphere, and below it
FILL = np.ones((3, 3), np.uint8)  # cells that the rays of all spheres have missed


class Ground(NamedTuple):
    """A picture (H, W, 4), y of the map up; where its middle is, and how wide and high it is, m."""

    picture: Bytes
    middle: tuple[float, float]
    size: tuple[float, float]


def ground_of(path: Path) -> Ground:
    """Return the picture of a map; ValueError or OSError for what is none."""
    with open_map(path) as reader:
        places = np.array([node.T_map_sphere.translation[:2] for node in reader.graph])
        low, high = places.min(axis=0) - REACH_M, places.max(axis=0) + REACH_M
        cell = max(CELL_M, float((high - low).max()) / MAX_CELLS)
        width, height = np.ceil((high - low) / cell).astype(int)
        sums = np.zeros((height * width, 4))
        for node in reader.graph:
            points, colors = reader.load_sphere(node.id).points()
            is_near = np.hypot(points[:, 0], points[:, 1]) < REACH_M
            placed = node.T_map_sphere.apply(points[is_near].astype(np.float64))
            is_below = placed[:, 2] < node.T_map_sphere.translation[2] - BELOW_M
            column, row = ((placed[is_below, :2] - low) / cell).astype(int).T
            where = np.clip(height - 1 - row, 0, height - 1) * width + np.clip(column, 0, width - 1)
            add_colors(sums, where, colors[is_near][is_below])
    picture = np.divide(sums, sums[:, 3:], out=np.zeros_like(sums), where=sums[:, 3:] > 0).reshape(height, width, 4)
    middle = 0.5 * (low + (low + np.array([width, height]) * cell))
    return Ground(closed(picture), (float(middle[0]), float(middle[1])), (width * cell, height * cell))


def add_colors(sums: Array, where: NDArray[Any], colors: Bytes) -> None:
    """Add grey or RGB values (N,) to the sums (M, 4) of cells, the last of which counts."""
    colors = colors if colors.ndim == 2 else np.repeat(colors[:, None], 3, axis=1)
    for channel in range(3):
        sums[:, channel] += np.bincount(where, colors[:, channel], len(sums))
    sums[:, 3] += np.bincount(where, minlength=len(sums))


def closed(picture: Array) -> Bytes:
    """Return a picture whose last channel is 1 where something was seen as RGBA; others show what is beside them."""
    seen = np.clip(picture * (1, 1, 1, 255), 0, 255).astype(np.uint8)
    return np.where(seen[..., 3:] > 0, seen, cv2.dilate(seen, FILL)).astype(np.uint8)
