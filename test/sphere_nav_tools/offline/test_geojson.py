"""Maps on the earth."""

import json

import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph
from sphere_nav_tools.offline.geojson import Datum, geojson

# Lengths of a degree from tables of WGS 84: 110.574 and 111.320 km at the equator, 111.132 and 78.847 km at 45 deg
TABLE = [(0.0, 110574.3, 111319.5), (45.0, 111131.8, 78846.8)]


def test_meters_become_degrees():
    for latitude, per_latitude, per_longitude in TABLE:
        for heading in [0.0, 90.0, 30.0]:
            datum = Datum(latitude, 10.0, heading)
            ahead = datum.locate(SE3.from_planar(1000.0, 0.0, 0.0))
            left = datum.locate(SE3.from_planar(0.0, 1000.0, 0.0))
            c, s = np.cos(np.radians(heading)), np.sin(np.radians(heading))
            for found, (east, north) in ((ahead, (s, c)), (left, (-c, s))):
                assert (found[0] - 10.0) * per_longitude == pytest.approx(1000 * east, abs=0.3)
                assert (found[1] - latitude) * per_latitude == pytest.approx(1000 * north, abs=0.3)
                assert found[2] == pytest.approx(1000**2 / 2 / 6.37e6, abs=0.002)  # the plane leaves the ellipsoid


def test_key_spheres_have_compass_headings_and_edges_their_ends():
    nodes = [KeySphere(3, 2_000_000_000, SE3.from_planar(0, 0, np.pi / 2)), KeySphere(4, 5, SE3.from_planar(9, 0, 0))]
    edge = Edge(3, 4, SE3.identity(), np.eye(6), is_loop=True)
    found = json.loads(geojson(SphereGraph(nodes, [edge]), Datum(43.6, 7.0, 90.0)))
    point, other, line = found["features"]
    assert found["type"] == "FeatureCollection"
    assert point["properties"] == {"id": 3, "stamp_s": 2.0, "heading_deg": 0.0}  # x is east, it looks along y: north
    assert other["properties"]["heading_deg"] == 90.0
    assert line["properties"] == {"from": 3, "to": 4, "loop": True}
    ends = [point["geometry"]["coordinates"], other["geometry"]["coordinates"]]
    assert line["geometry"]["coordinates"] == ends


def test_no_datum_is_refused():
    for text in ["", "1,2", "91,0,0", "0,200,0", "a,b,c", "1,2,nan"]:
        with pytest.raises(ValueError, match="lat,lon,heading"):
            Datum.parse(text)
