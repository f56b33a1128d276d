"""A map for other tools: points of all key spheres with colours (.ply), and where on the earth.

GeoJSON (RFC 7946) has key spheres and edges, given where the origin of the map is.
"""

from __future__ import annotations

import json
from argparse import ArgumentTypeError
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyproj import Transformer

from sphere_mapping.map_cloud import thin_points
from sphere_mapping.params import CloudParams
from sphere_nav.geometry import SE3
from sphere_nav.spheres.graph import KeySphere, SphereGraph
from sphere_nav.spheres.sphere import Sphere, to_rgb
from sphere_nav_tools.offline.settings import floats

COLORS = ("red", "green", "blue")
POINT = np.dtype([(name, "<f4") for name in "xyz"] + [(name, "u1") for name in COLORS])  # m in the map, levels
Cloud = NDArray[Any]  # (N,) of POINT


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


DECIMALS = 9  # of a degree: a tenth of a millimetre


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
            raise ArgumentTypeError(f"expected lat,lon,heading in degrees, found {text!r}")
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
        return [round(longitude, DECIMALS), round(latitude, DECIMALS), round(height, 4)]


def geojson(graph: SphereGraph, datum: Datum) -> str:
    """Return a FeatureCollection: a point for each key sphere (id, stamp, heading), a line for each edge."""
    places = {node.id: datum.locate(node.T_map_sphere) for node in graph}
    features: list[dict[str, Any]] = []
    for node in graph:
        ahead = node.T_map_sphere.rotation[:2, 0]
        heading = (datum.heading - np.degrees(np.arctan2(ahead[1], ahead[0]))) % 360.0
        properties = {"id": node.id, "stamp_s": node.stamp_ns / 1e9, "heading_deg": round(float(heading), 3)}
        features.append(_feature("Point", places[node.id], properties))
    for edge in graph.edges:
        properties = {"from": edge.a, "to": edge.b, "loop": edge.is_loop}
        features.append(_feature("LineString", [places[edge.a], places[edge.b]], properties))
    return json.dumps({"type": "FeatureCollection", "features": features}, indent=1) + "\n"


def _feature(kind: str, coordinates: Any, properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": {"type": kind, "coordinates": coordinates}, "properties": properties}
