"""`sphere_nav map-export`: a map as point cloud, pose graph or trajectory."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from sphere_mapping.graph.graph_file import write_g2o
from sphere_mapping.params import CloudParams
from sphere_nav.geometry.trajectory import write_tum
from sphere_nav.ros.maps.reader import MapReader, open_map
from sphere_nav_tools.offline.map_points import Datum, cloud_of, geojson, write_ply
from sphere_nav_tools.offline.pose_bags import trajectory_of
from sphere_nav_tools.offline.settings import add, add_output
from sphere_nav_tools.offline.tables import progress

Writer = Callable[[MapReader, Path, argparse.Namespace], str]

HELP = """\
Write a map in a format that other tools read; the suffix of the output says which.

  .ply  point cloud with colours, map frame, metres (binary)
  .g2o  pose graph, VERTEX_SE3:QUAT and EDGE_SE3:QUAT
  .tum  pose of every key sphere: stamp x y z qx qy qz qw
  .geojson  key spheres and edges by longitude and latitude (WGS 84), given --datum

examples:
  sphere_nav map-export kitchen_map -o kitchen.ply --step 4
  sphere_nav map-export kitchen_map -o kitchen.g2o
  sphere_nav map-export campus -o campus.geojson --datum 43.6161,7.0678,90
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add(parser, "map", "MAP", "a map (a folder)", Path)
    add_output(parser, "FILE", "file to write", tuple(WRITERS))
    add(parser, "--step", "STEP", "clouds: every how many rows and columns (%(default)s)", int, default=4)
    add(parser, "--max-range", "M", "clouds: farther is left out", float, default=50.0)
    add(
        parser,
        "--datum",
        "lat,lon,heading",
        ".geojson: where the map begins, and its x axis from north, deg",
        Datum.parse,
    )


def run(arguments: argparse.Namespace) -> None:
    """Write the file."""
    output: Path = arguments.output
    part = output.with_name(output.name + ".part")
    with open_map(arguments.map) as reader:
        count = WRITERS[output.suffix](reader, part, arguments)
    part.replace(output)
    print(f"{output}: {count}")


def write_cloud(reader: MapReader, path: Path, arguments: argparse.Namespace) -> str:
    """Write the points of all key spheres."""
    params = CloudParams(step=arguments.step, max_range_m=arguments.max_range)
    nodes = progress("export", "sphere", list(reader.graph))
    return f"{write_ply(path, [cloud_of(node, reader.load_sphere(node.id), params) for node in nodes])} points"


def write_geojson(reader: MapReader, path: Path, arguments: argparse.Namespace) -> str:
    """Write key spheres and edges on the earth."""
    if not arguments.datum:
        raise ValueError(".geojson: expected --datum lat,lon,heading of the map's origin, found none")
    path.write_text(geojson(reader.graph, arguments.datum), encoding="utf-8")
    return f"{len(reader.graph)} points, {len(reader.graph.edges)} lines"


def write_graph(reader: MapReader, path: Path, _: argparse.Namespace) -> str:
    """Write the graph: information of (translation, rotation vector), as GTSAM reads it."""
    write_g2o(path, reader.graph)
    return f"{len(reader.graph)} vertices, {len(reader.graph.edges)} edges"


def write_trajectory(reader: MapReader, path: Path, _: argparse.Namespace) -> str:
    """Write the poses of the key spheres by stamp."""
    nodes = sorted(reader.graph, key=lambda node: node.stamp_ns)
    poses = trajectory_of([node.stamp_ns for node in nodes], [node.T_map_sphere for node in nodes])
    write_tum(path, poses, str(reader.info.map_id))
    return f"{len(nodes)} poses"


WRITERS: dict[str, Writer] = {
    ".ply": write_cloud,
    ".g2o": write_graph,
    ".tum": write_trajectory,
    ".geojson": write_geojson,
}
