"""One path of a way over the network: points, headings and speeds. From beside it the follower steers onto it."""

from __future__ import annotations

import numpy as np

from path_follower.constants import MAX_POINTS
from path_follower.routes.network import Network
from path_follower.routes.planning import Route
from sphere_nav.geometry.arrays import Array


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
