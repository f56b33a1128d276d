"""A map on the earth: key spheres and edges as GeoJSON (RFC 7946), given where its origin is."""

from __future__ import annotations

import json
from argparse import ArgumentTypeError
from dataclasses import dataclass
from typing import Any

import numpy as np

from mcl_depth.geometry.geodetic import AXIS, place_on_earth
from sphere_nav.geometry import SE3
from sphere_nav.spheres.graph import SphereGraph
from sphere_nav_tools.offline.settings import floats

DECIMALS = 9  # of a degree: a tenth of a millimetre
NUM_STEPS = 8  # each leaves a hundredth of what is missing


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

    def locate(self, T_map_any: SE3) -> list[float]:
        """Return longitude and latitude in degrees, and height in m, of a pose.

        On the ellipsoid through geocentric coordinates, so that kilometres stay right.
        """
        x, y, z = T_map_any.translation
        c, s = np.cos(np.radians(self.heading)), np.sin(np.radians(self.heading))
        latitude, longitude = np.radians([self.latitude, self.longitude])
        axes, origin = place_on_earth(latitude, longitude)
        point = origin + axes @ np.array([s * x - c * y, c * x + s * y, z])
        longitude = np.arctan2(point[1], point[0])
        for _ in range(NUM_STEPS):  # to the latitude at which the point is straight above
            axes, origin = place_on_earth(latitude, longitude)
            _, north, up = (point - origin) @ axes
            latitude += north / AXIS
        degrees = [round(float(np.degrees(angle)), DECIMALS) for angle in (longitude, latitude)]
        return [*degrees, round(float(up), 4)]


def geojson(graph: SphereGraph, datum: Datum) -> str:
    """Return a FeatureCollection: a point for each key sphere (id, stamp, heading), a line for each edge."""
    places = {node.id: datum.locate(node.T_map_sphere) for node in graph}
    features: list[dict[str, Any]] = []
    for node in sorted(graph, key=lambda node: node.id):
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
