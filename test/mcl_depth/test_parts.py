"""The smaller pieces of the image side, each by itself."""

from __future__ import annotations

import numpy as np

from mcl_depth.geometry.cloud import cloud_from_points
from mcl_depth.geometry.mesh import RayScene, mesh_from_faces
from mcl_depth.geometry.splats import Splats
from mcl_depth.geometry.synthesis import panorama_window
from mcl_depth.params import SynthesisParams

PARAMS = SynthesisParams(num_columns=72)


def test_one_point_and_one_triangle_lie_where_they_are() -> None:
    camera = panorama_window(PARAMS)
    place = np.zeros((1, 3))
    points = Splats(cloud_from_points(np.array([[0.0, 5.0, 0.0]])), camera, PARAMS).ranges(place)[0]
    corners = np.array([[-1.0, 5.0, -1.0], [1.0, 5.0, -1.0], [0.0, 5.0, 2.0]])
    surface = RayScene(mesh_from_faces(corners, np.array([[0, 1, 2]]), "one"), camera, PARAMS).ranges(place)[0]
    for found in (points, surface):
        rows, columns = np.nonzero(np.isfinite(found))
        assert abs(np.median(columns) - 17.5) <= 1.0  # 90 degrees to the left is a quarter of the way
        assert abs(np.nanmin(found) - 5.0) < 0.02  # a pixel is 5 degrees wide
        assert len(rows) >= 1
