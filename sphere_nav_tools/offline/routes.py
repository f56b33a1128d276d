"""Networks of taught paths, for the command `route` and a page: from files of drives, in words, as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from path_follower.params import FollowerParams, VehicleParams
from path_follower.path import Pose2
from path_follower.path_files import read_drives, write_course
from path_follower.routes.building import TaughtDrive, build_network
from path_follower.routes.constants import MAX_TURN
from path_follower.routes.network import Network, RouteEdge, Spot
from path_follower.routes.network_file import network_path, read_network, write_network
from path_follower.routes.planning import Route, make_course, plan
from sphere_nav.ros.maps.reader import open_map
from sphere_nav_tools.offline.constants import NETWORK_REACH
from sphere_nav_tools.offline.tables import columns

COURSE = "course.csv"  # a way that a page has made
EDGE, WAY = "#1f77b4", "#d62728"
CRUISE = FollowerParams().speed.cruise  # m/s, by which ways are compared


def map_id_of(path: Path) -> str:
    """Return the id of a map; of anything that is no folder nothing is known."""
    if not path.is_dir():
        return ""
    with open_map(path) as reader:
        return str(reader.info.map_id)


def read_network_of(files: Sequence[Path], map_id: str, *, is_reversible: bool = False) -> Network:
    """Return the network of drives in files; ValueError for those of another map."""
    drives: list[TaughtDrive] = []
    for file in files:
        found, theirs = read_drives(file, FollowerParams(), is_reversible=is_reversible)
        if map_id and theirs and theirs != map_id:
            raise ValueError(f"{file}: map_id: expected {map_id}, found {theirs}: drives of one map make a network")
        map_id = map_id or theirs
        drives += found
    return build_network(drives, map_id)


def network_of(made: Path, taught: Path | None) -> Network:
    """Return the network of a map; or that of the drive that it was made of. ValueError for neither."""
    if network_path(made).exists():
        return read_network(network_path(made))
    if taught is None:
        raise ValueError("places: expected a map with a taught path, found none: sphere_nav route build makes one")
    return read_network_of([taught], map_id_of(made))


def find_spot(network: Network, x: float, y: float, *yaw: float) -> Spot:
    """Return the spot of a network that is closest to a position, and heads as asked for; ValueError where none is."""
    heading, max_turn = (yaw[0], MAX_TURN) if yaw else (0.0, np.inf)
    found = network.locate(Pose2(x, y, heading), NETWORK_REACH, max_turn)
    if not found:
        raise ValueError(f"--at: expected a position within {NETWORK_REACH:g} m of the network, found {x:g}, {y:g}")
    return min(found, key=lambda spot: abs(spot.left))


def name_place(file: Path, network: Network, name: str, *at: float) -> Network:
    """Name the spot of a network that is closest to x, y[, yaw], and keep that in a file; return the network."""
    named = network.with_place(name, find_spot(network, *at))
    write_network(file, named)
    return named


def write_way(file: Path, network: Network, route: Route) -> int:
    """Write a way on a network as a path, and return the number of its points."""
    points = make_course(network, route)
    write_course(file, points, network.map_id, VehicleParams().max_speed)
    return len(points)


def way_to(network: Network, pose: Sequence[float], goal: Sequence[float], folder: Path) -> Path:
    """Write the way from a pose to the closest point of the network, and return the file; ValueError for no way."""
    begin, end = find_spot(network, *pose), find_spot(network, *goal)
    write_way(folder / COURSE, network, plan(network, [begin], [end], cruise=CRUISE))
    return folder / COURSE


def describe(network: Network) -> list[str]:
    """Return the network in lines: what is in it, its edges, its places."""
    total = sum(edge.length for edge in network.edges.values())
    num = f"{len(network.nodes)} nodes, {len(network.edges)} edges"
    lines = [f"{num}, {total:.1f} m, map {network.map_id or 'unknown'}"]
    lines += columns([("edge", "from", "to", "length", "speed", "driven"), *map(_edge_row, network.edges.values())])
    return lines + [f"place {name}: node {node}" for name, node in sorted(network.places.items())]


def _edge_row(edge: RouteEdge) -> Sequence[str | int]:
    known = edge.curve.speed[np.isfinite(edge.curve.speed)]
    speed = f"{known.max():.2f}" if len(known) else "-"
    way = "both ways" if edge.is_forward and edge.is_reverse else "forward" if edge.is_forward else "backwards"
    return edge.id, edge.start, edge.end, f"{edge.length:.1f}", speed, way


def describe_route(network: Network, route: Route) -> list[str]:
    """Return a way in lines: its legs, and what they add up to."""
    lines = []
    for leg in route.legs:
        edge = network.edges[leg.edge]
        name = network.name_of(edge.end if leg.direction > 0 else edge.start)
        lines.append(
            f"edge {leg.name:>4}  {leg.length:>7.1f} m  {'backwards  ' if leg.direction < 0 else ''}{name}".rstrip()
        )
    return [*lines, f"{route.length:.1f} m, {route.seconds:.0f} s"]


def draw_network(path: Path, network: Network, route: Route | None = None) -> None:
    """Draw edges with their numbers and arrows for the ways they are driven, branches, places, and a way."""
    from sphere_nav_tools.offline.plot_figure import drawn, in_meters  # matplotlib takes half a second to import

    with drawn(path, (10, 8)) as figure:
        axes = figure.add_subplot()
        for edge in network.edges.values():
            axes.plot(edge.curve.x, edge.curve.y, color=EDGE, lw=1.5)
            middle, ahead = (edge.curve.pose(share * edge.length)[:2] for share in (0.5, 0.51))
            style = "<|" * edge.is_reverse + "-" + "|>" * edge.is_forward
            arrow = {"arrowstyle": style, "color": EDGE, "mutation_scale": 14}
            axes.annotate("", ahead, middle, arrowprops=arrow)
            axes.annotate(str(edge.id), middle, (4, 4), textcoords="offset points", color=EDGE)
        for leg in route.legs if route is not None else ():
            part = network.edges[leg.edge].curve.part(min(leg.first, leg.last), max(leg.first, leg.last))
            axes.plot(part.x, part.y, color=WAY, lw=5, alpha=0.35)
        axes.plot(*np.array([node[:2] for node in network.nodes.values()]).T, "o", color="black", ms=4)
        for name, node in network.places.items():
            axes.annotate(name, network.nodes[node][:2], (6, 6), textcoords="offset points", weight="bold")
        if route is not None:
            axes.set_title(f"{route.length:.0f} m, {route.seconds:.0f} s", loc="left")
        in_meters(axes)
