"""Places on the paths of the map in use, named by a click, and the way to one of them as a path for the follower."""

from __future__ import annotations

from pathlib import Path

from path_follower.routes.network import Network
from path_follower.routes.network_file import network_path, read_network
from path_follower.routes.planning import plan
from sphere_nav_tools.cli.operate.words import Place
from sphere_nav_tools.offline import routes

COURSE = "course.csv"


def network_of(made: Path, taught: Path | None) -> Network:
    """Return the network of a map; or that of the drive that it was made of. ValueError for neither."""
    if network_path(made).exists():
        return read_network(network_path(made))
    if taught is None:
        raise ValueError("places: expected a map with a taught path, found none: sphere_nav route build makes one")
    return routes.read_network_of([taught], routes.map_id_of(made))


def name_place(made: Path, taught: Path | None, name: str, x: float, y: float) -> list[Place]:
    """Name the place of the network that is closest to a point, keep it in the map, and return all places."""
    named = routes.name_place(network_path(made), network_of(made, taught), name, x, y)
    return [Place(name, *named.nodes[node][:2]) for name, node in named.places.items()]


def way_to(network: Network, pose: tuple[float, float, float], goal: tuple[float, float], folder: Path) -> Path:
    """Write the way from a pose to the closest point of the network, and return the file; ValueError for no way."""
    begin, end = routes.find_spot(network, *pose), routes.find_spot(network, *goal)
    routes.write_way(folder / COURSE, network, plan(network, [begin], [end], cruise=routes.CRUISE))
    return folder / COURSE
