"""The map from above: key spheres, edges, and where one looks from."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import SE3
from sphere_nav.spheres.graph import SphereGraph

SIDE, BORDER = 300, 20  # px
MIN_EXTENT_M = 10.0
PAPER = (250, 250, 247)
COLORS = {"way": (150, 150, 150), "loops": (220, 120, 30), "key": (40, 90, 160), "camera": (200, 30, 30)}
ARROW_PX = 14.0
Picture = NDArray[np.uint8]


class Minimap:
    """Draws a graph once, and a pose into a copy as often as it is asked; x of the map to the right, y up."""

    def __init__(self, graph: SphereGraph) -> None:
        points = np.array([node.T_map_sphere.translation[:2] for node in graph])
        self._middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        extent = max(float(np.ptp(points, axis=0).max()), MIN_EXTENT_M)
        self._scale = (SIDE - 2 * BORDER) / extent
        self._base: Picture = np.full((SIDE, SIDE, 3), PAPER, np.uint8)
        for edge in graph.edges:
            ends = [tuple(self.pixel(graph[end].T_map_sphere)) for end in (edge.a, edge.b)]
            cv2.line(self._base, *ends, COLORS["loops" if edge.is_loop else "way"], 1, cv2.LINE_AA)
        for node in graph:
            cv2.circle(self._base, tuple(self.pixel(node.T_map_sphere)), 2, COLORS["key"], -1, cv2.LINE_AA)

    def pixel(self, T_map_any: SE3) -> list[int]:
        """Return the column and row of a pose."""
        x, y = (T_map_any.translation[:2] - self._middle) * self._scale
        return [round(float(0.5 * SIDE + x)), round(float(0.5 * SIDE - y))]

    def draw(self, T_map_camera: SE3) -> Picture:
        """Return the picture (SIDE, SIDE, 3) with an arrow where a camera (z forward) looks."""
        picture = self._base.copy()
        u, v = self.pixel(T_map_camera)
        ahead = T_map_camera.rotation[:2, 2]
        length = float(np.linalg.norm(ahead))
        du, dv = ARROW_PX * ahead / length * (1.0, -1.0) if length > 1e-6 else (0.0, 0.0)
        tip = (round(u + float(du)), round(v + float(dv)))
        cv2.arrowedLine(picture, (u, v), tip, COLORS["camera"], 2, cv2.LINE_AA, tipLength=0.5)
        cv2.circle(picture, (u, v), 4, COLORS["camera"], -1, cv2.LINE_AA)
        return picture
