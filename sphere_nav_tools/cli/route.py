"""`sphere_nav route`: taught paths of one map as a network with named places."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np

from path_follower.routes.network import Network
from path_follower.routes.network_file import network_path, read_network, to_geojson, write_network
from path_follower.routes.planning import Route, plan
from sphere_nav_tools.offline import routes
from sphere_nav_tools.offline.settings import (
    PICTURES,
    FileAction,
    add,
    add_output,
    add_overwrite,
    check_free,
    flag,
    floats,
)

HELP = """\
Make a network of taught paths: what drives share is one edge, where they part or meet is a branch. The network is
kept in the folder of its map (routes.geojson), as Nav2's Route Server reads it, with the dense curves of its edges.

  build   make the network of drives (.tum or .csv, as path_follower takes them)
  name    give a name to a place on it
  show    tell what is in it, draw it
  plan    tell the way between two places
  export  write it without dense curves (.geojson), or a way between two places as a path (.csv)

NETWORK is a map that has one, or a .geojson file.

examples:
  sphere_nav route build maps/campus drives/*.tum --dry-run --plot campus.png
  sphere_nav route build maps/campus drives/*.tum
  sphere_nav route name gate maps/campus --at 41.5,60
  sphere_nav route plan maps/campus home gate --closed 12
  sphere_nav route export maps/campus -o way.csv --from home --to gate
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of each word."""
    words = parser.add_subparsers(dest="word", required=True, metavar="build|name|show|plan|export")
    build = words.add_parser("build", help="make the network of drives")
    add(build, "map", "MAP", "map of the drives; or the .geojson file to write", Path)
    add(build, "drives", "DRIVE", "taught paths, the first begins at `home`", Path, nargs="+")
    flag(build, "--reversible", "all edges may be driven backwards, too")
    flag(build, "--dry-run", "show what would be made, write nothing but the plot")
    name = words.add_parser("name", help="give a name to a place")
    add(name, "name", "NAME", "of the place")
    _add_network(name)
    add(
        name,
        "--at",
        "X,Y[,YAW]",
        "m, m and deg in the map; of several lanes the one that heads so",
        floats("X,Y or X,Y,YAW", 2, 3),
        required=True,
    )
    look = words.add_parser("show", help="tell what is in a network")
    _add_network(look)
    way = words.add_parser("plan", help="tell the way between two places")
    _add_network(way)
    add(way, "start", "FROM", "place")
    add(way, "goal", "TO", "place")
    export = words.add_parser("export", help="write the network, or a way on it")
    _add_network(export)
    add_output(export, "FILE", ".geojson or .csv", (".geojson", ".csv"))
    add(export, "--from", "PLACE", ".csv: begin of the way", dest="start")
    add(export, "--to", "PLACE", ".csv: end of the way", dest="goal")
    for word in (way, export):
        add(word, "--closed", "N,N", "edges that are not driven", floats("N,N", 1, 1000), default=())
        add(word, "--cruise", "M/S", "largest speed (%(default)s)", float, default=routes.CRUISE)
    for word in (build, look, way):
        told = f"picture to write ({', '.join(PICTURES)})"
        add(word, "--plot", "FILE", told, Path, action=FileAction, const=PICTURES)
        add_overwrite(word)
    acts = {build: make_network, name: name_place, look: show, way: plan_way, export: export_network}
    for word, act in acts.items():
        word.set_defaults(act=act)


def _add_network(parser: argparse.ArgumentParser) -> None:
    add(parser, "network", "NETWORK", "a map that has one, or a .geojson file", Path)


def run(arguments: argparse.Namespace) -> int | None:
    """Carry out one word."""
    act: Callable[..., int | None] = arguments.act
    return act(arguments)


def make_network(arguments: argparse.Namespace) -> None:
    """Make, show, and keep a network."""
    output = network_path(arguments.map)
    if output.suffix != ".geojson":
        raise ValueError(f"{arguments.map}: expected a map, or a .geojson file to write, found neither")
    if not arguments.dry_run:
        check_free(arguments, output, loss=", its places with it")
    map_id = routes.map_id_of(arguments.map)
    network = routes.read_network_of(arguments.drives, map_id, is_reversible=arguments.reversible)
    _tell(arguments, network, routes.describe(network))
    if arguments.dry_run:
        print(f"{output}: not written (--dry-run)")
    else:
        write_network(output, network)
        print(f"{output}: written")


def name_place(arguments: argparse.Namespace) -> None:
    """Name a place."""
    path, (x, y, *turned) = network_path(arguments.network), arguments.at
    named = routes.name_place(path, read_network(path), arguments.name, x, y, *np.radians(turned))
    node = named.places[arguments.name]
    x, y, yaw = named.nodes[node]
    print(f"{path}: {arguments.name} is node {node} at {x:.2f}, {y:.2f}, heading {np.degrees(yaw):.0f} deg")


def show(arguments: argparse.Namespace) -> None:
    """Tell what is in a network."""
    network = _read(arguments)
    _tell(arguments, network, routes.describe(network))


def plan_way(arguments: argparse.Namespace) -> int:
    """Tell a way; 1 where there is none."""
    network = _read(arguments)
    try:
        route = _way(network, arguments)
    except ValueError as error:
        if not str(error).startswith("no way"):
            raise
        print(error)
        return 1
    _tell(arguments, network, routes.describe_route(network, route), route)
    return 0


def export_network(arguments: argparse.Namespace) -> None:
    """Write a network, or a way on it."""
    network, output = _read(arguments), arguments.output
    if output.suffix == ".geojson":
        output.write_text(to_geojson(network, is_dense=False), encoding="utf-8")
        print(f"{output}: {len(network.nodes)} nodes, {len(network.edges)} edges")
    elif arguments.start and arguments.goal:
        route = _way(network, arguments)
        print(f"{output}: {routes.write_way(output, network, route)} points, {route.length:.1f} m")
    else:
        raise ValueError(f"{output}: expected --from and --to for .csv, found neither")


def _read(arguments: argparse.Namespace) -> Network:
    return read_network(network_path(arguments.network))


def _way(network: Network, arguments: argparse.Namespace) -> Route:
    closed = {int(edge) for edge in arguments.closed}
    if unknown := closed - set(network.edges):
        raise ValueError(f"--closed: expected edges of the network, found {sorted(unknown)[0]}")
    starts, goals = (network.spots_of(network.node_of(place)) for place in (arguments.start, arguments.goal))
    return plan(network, starts, goals, cruise=arguments.cruise, closed=closed)


def _tell(arguments: argparse.Namespace, network: Network, lines: list[str], route: Route | None = None) -> None:
    print("\n".join(lines))
    if arguments.plot is not None:
        routes.draw_network(arguments.plot, network, route)
        print(f"{arguments.plot}: drawn")
