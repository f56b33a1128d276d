"""`sphere_nav map-export`: a map as point cloud with colours, pose graph, trajectory, or on the earth (RFC 7946)."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyproj import Transformer

from sphere_mapping.graph.graph_file import write_g2o
from sphere_mapping.map_cloud import thin_points
from sphere_mapping.params import CloudParams
from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import write_tum
from sphere_nav.ros.maps.reader import MapReader, open_map
from sphere_nav.spheres.graph import KeySphere, SphereGraph
from sphere_nav.spheres.sphere import Sphere, to_rgb
from sphere_nav_tools.offline.evaluation import trajectory_of
from sphere_nav_tools.offline.settings import add, add_output, floats
from sphere_nav_tools.offline.tables import progress

Writer = Callable[[MapReader, Path, argparse.Namespace], str]
COLORS = ("red", "green", "blue")
POINT = np.dtype([(name, "<f4") for name in "xyz"] + [(name, "u1") for name in COLORS])  # m in the map, levels
Cloud = NDArray[Any]  # (N,) of POINT
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


def cloud_of(node: KeySphere, sphere: Sphere, params: CloudParams) -> Cloud:
    """Return the thinned points of one key sphere in the map frame."""
    points, levels = thin_points(replace(sphere, image=to_rgb(sphere.image)), params)
    return np.rec.fromarrays([*node.T_map_sphere.apply(points).T, *levels.T], dtype=POINT)


def write_ply(path: Path, clouds: list[Cloud]) -> int:
    """Write a binary PLY; return the number of points."""
    table = np.concatenate(clouds)
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(table)}"]
    head += [f"property {'uchar' if name in COLORS else 'float'} {name}" for name in POINT.names or ()] + ["end_header"]
    path.write_bytes(("\n".join(head) + "\n").encode() + table.tobytes())
    return len(table)


@dataclass(frozen=True)
class Datum:
    """Where the origin of a map is: latitude and longitude in degrees, and the heading of its x axis from north.

    The heading is clockwise in degrees, as a compass has it: 90 means that x points east.
    """

    latitude: float
    longitude: float
    heading: float

    @classmethod
    def parse(cls, text: str) -> Datum:
        """Read the argument `lat,lon,heading`."""
        found = cls(*floats("lat,lon,heading in degrees", 3)(text))
        if not (abs(found.latitude) < 89.9 and abs(found.longitude) <= 180.0):
            raise argparse.ArgumentTypeError(f"expected lat,lon,heading in degrees, found {text!r}")
        return found

    @cached_property
    def _to_degrees(self) -> Transformer:
        """From metres east, north and up to longitude and latitude in degrees, and height in m, on the ellipsoid."""
        here = f"step inv proj=topocentric ellps=WGS84 lat_0={self.latitude!r} lon_0={self.longitude!r}"
        degrees = "step inv proj=cart ellps=WGS84 step proj=unitconvert xy_in=rad xy_out=deg"
        return Transformer.from_pipeline(f"proj=pipeline {here} {degrees}")

    def locate(self, T_map_any: SE3) -> list[float]:
        """Return longitude and latitude in degrees, and height in m, of a pose."""
        x, y, z = T_map_any.translation
        c, s = np.cos(np.radians(self.heading)), np.sin(np.radians(self.heading))
        longitude, latitude, height = self._to_degrees.transform(s * x - c * y, c * x + s * y, z)
        return [round(longitude, 9), round(latitude, 9), round(height, 4)]  # to a tenth of a millimetre


def geojson(graph: SphereGraph, datum: Datum) -> str:
    """Return a FeatureCollection: a point for each key sphere (id, stamp, heading), a line for each edge."""
    places = {node.id: datum.locate(node.T_map_sphere) for node in graph}
    features: list[dict[str, Any]] = []
    for node in graph:
        heading = (datum.heading - float(np.degrees(node.T_map_sphere.yaw))) % 360.0
        properties = {"id": node.id, "stamp_s": node.stamp_ns / 1e9, "heading_deg": round(heading, 3)}
        features.append(_feature("Point", places[node.id], properties))
    for edge in graph.edges:
        properties = {"from": edge.a, "to": edge.b, "loop": edge.is_loop}
        features.append(_feature("LineString", [places[edge.a], places[edge.b]], properties))
    return json.dumps({"type": "FeatureCollection", "features": features}, indent=1) + "\n"


def _feature(kind: str, coordinates: Any, properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": {"type": kind, "coordinates": coordinates}, "properties": properties}
