"""The ground of a map as a picture from above, of what its key spheres saw below themselves."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from sphere_nav.geometry.arrays import Bytes
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
    """Return the picture of a map, of the last key sphere that saw a cell; ValueError or OSError for what is none."""
    with open_map(path) as reader:
        places = np.array([node.T_map_sphere.translation[:2] for node in reader.graph])
        low, extent = places.min(axis=0) - REACH_M, np.ptp(places, axis=0) + 2.0 * REACH_M
        cell = max(CELL_M, float(extent.max()) / MAX_CELLS)
        width, height = np.ceil(extent / cell).astype(int)
        picture = np.zeros((height, width, 4), np.uint8)
        for node in reader.graph:
            points, colors = reader.load_sphere(node.id).points()
            placed = node.T_map_sphere.apply(points.astype(np.float64))
            off = placed - node.T_map_sphere.translation
            is_below = (off[:, 2] < -BELOW_M) & (np.hypot(off[:, 0], off[:, 1]) < REACH_M)
            column, row = ((placed[is_below, :2] - low) / cell).astype(int).T
            picture[row, column, :3] = colors[is_below].reshape(len(row), -1)
            picture[row, column, 3] = 255
    seen = np.where(picture[..., 3:] > 0, picture, cv2.dilate(picture, FILL)).astype(np.uint8)[::-1]
    size = (float(width * cell), float(height * cell))
    return Ground(seen, (float(low[0] + 0.5 * size[0]), float(low[1] + 0.5 * size[1])), size)
