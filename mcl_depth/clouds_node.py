"""Where the geometry comes from: a file, a map of our own, or the call load_cloud."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from sphere_nav_msgs.srv import LoadCloud

from mcl_depth.cloud import Cloud, cloud_from_points
from mcl_depth.geometry_files import read_geometry
from mcl_depth.mesh import TriangleMesh
from node_kit.map_bag import open_map

if TYPE_CHECKING:
    from mcl_depth.node import MclDepthNode

STEP = 2  # every second pixel of every second row of a sphere becomes a point


class CloudCalls:
    """The service load_cloud of a node."""

    def __init__(self, node: MclDepthNode) -> None:
        self._node = node
        node.serve("load_cloud", LoadCloud, self.on_load_cloud)

    def on_load_cloud(self, request: LoadCloud.Request, response: LoadCloud.Response) -> LoadCloud.Response:
        """Use another cloud; one that cannot be read leaves the present one in force."""
        started = time.perf_counter()
        try:
            self._node.load(request.path)
        except (ValueError, OSError) as error:
            response.message = " ".join(str(error).split())
            return response
        geometry = self._node.geometry
        assert geometry is not None
        response.num_points = len(geometry.vertices if isinstance(geometry, TriangleMesh) else geometry.points)
        for corner, values in zip((response.minimum, response.maximum), geometry.box, strict=True):
            corner.x, corner.y, corner.z = (float(value) for value in values)
        response.success, response.message = True, f"{response.num_points} points of {request.path}"
        response.seconds = time.perf_counter() - started
        return response


def read_map(path: str) -> Cloud | TriangleMesh:
    """Return the geometry of a file, or of a folder of key spheres."""
    if not Path(path).is_dir():
        return read_geometry(path)
    parts = [np.zeros((0, 3), np.float32)]
    with open_map(path) as reader:
        for node in reader.graph:
            points, _ = reader.load_sphere(node.id).points(STEP)
            parts.append(node.T_map_sphere.apply(points).astype(np.float32))
    return cloud_from_points(np.concatenate(parts), path)
