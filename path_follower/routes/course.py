"""One path of a way over the network: points, headings and speeds. From beside it the follower steers onto it.

It is handed over as a file.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from path_follower.constants import MAX_POINTS
from path_follower.path_files import UNBOUNDED
from path_follower.routes.network import Network
from path_follower.routes.planning import Route
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.files.whole_file import write_whole
from sphere_nav.geometry.trajectory import MAP_ID


def make_course(network: Network, route: Route) -> Array:
    """Return the path of a route: points (N, 4) in order of driving; ValueError for one of too many.

    Their columns are x, y, yaw of the vehicle, not of the way, and speed.
    """
    parts = [
        network.edges[leg.edge].curve.part(*sorted((leg.first, leg.last))).columns.T[:: leg.direction]
        for leg in route.legs
    ]
    points = np.concatenate([parts[0], *(part[1:] for part in parts[1:])])
    if len(points) > MAX_POINTS:
        raise ValueError(f"way: expected at most {MAX_POINTS} points, found {len(points)}: fewer laps")
    return points


def write_course(path: Path, points: Array, map_id: str, fastest: float = UNBOUNDED) -> None:
    """Write points of `make_course` for the follower; where a speed is not known it is `fastest`, or its limits."""
    head = f"{MAP_ID} {map_id}\n" if map_id else ""
    rows = np.where(np.isfinite(points), points, fastest).tolist()
    lines = "\n".join(",".join(f"{value:.5f}" for value in row) for row in rows)
    write_whole(path, f"{head}x,y,yaw,speed\n{lines}\n")
