"""What can be set in the route navigator."""

from __future__ import annotations

from path_follower.params import FrontParams
from sphere_nav.params import group, param, parameters


@parameters
class MissionParams:
    """How missions are driven."""

    cruise: float = param(
        1.4, "speed by which ways are compared and times are told: that of path_follower", "m/s", low=0.05
    )
    reach: float = param(
        0.8, "largest distance of the vehicle, or of a goal, from the network", "m", low=0.05, high=3.0
    )
    patience: float = param(15.0, "how long an obstacle may stand before another way is taken", "s", low=0.0)
    memory: float = param(300.0, "how long an edge counts as closed for an obstacle", "s", low=0.0)
    is_resuming: bool = param(True, "go on by itself where a pose, a status or a scan was missing and is back")


@parameters
class RouteNavigatorParams:
    """Everything that the node needs."""

    network: str = param("", "network of taught paths: a map that has one, or a .geojson file")
    map_frame: str = param("map", "frame of the poses and of the network")
    vehicle: FrontParams = group(FrontParams)
    mission: MissionParams = group(MissionParams)
