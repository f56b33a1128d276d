"""A map as points, and on the earth."""

import json

import numpy as np
import pytest

from sphere_mapping.params import CloudParams
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph
from sphere_nav.spheres.sphere import Sphere
from sphere_nav_tools.cli.maps.map_export import POINT, Datum, cloud_of, geojson, write_ply


def cloud():
    rng = np.random.default_rng(0)
    points = np.round(rng.uniform(-20, 20, (50, 3)), 3).astype(np.float32)
    levels = rng.integers(0, 256, (50, 3), dtype=np.uint8)
    return np.rec.fromarrays([*points.T, *levels.T], dtype=POINT)


def test_a_ply_has_every_number_under_its_name(tmp_path):
    one = cloud()
    assert write_ply(tmp_path / "a.ply", [one, one]) == 100
    data = (tmp_path / "a.ply").read_bytes()
    head, body = data.split(b"end_header\n", 1)
    assert b"element vertex 100" in head
    properties = [tuple(line.decode().split()[1:]) for line in head.splitlines() if line.startswith(b"property")]
    names = ["x", "y", "z", "red", "green", "blue"]
    assert properties == list(zip(["float"] * 3 + ["uchar"] * 3, names, strict=True))
    table = np.frombuffer(body, [(name, "<f4" if kind == "float" else "u1") for kind, name in properties])
    for name in names:
        np.testing.assert_array_equal(table[name][50:], one[name])


def test_points_are_of_every_so_many_rows_up_to_a_range():
    for max_range_m, count in [(4.99, 0), (5.01, 8 * 16)]:
        sphere = Sphere(np.full((32, 64), 9, np.uint8), np.full((32, 64), 5.0, np.float32), Spherical(64, 32))
        T = SE3.from_planar(1.0, 2.0, 0.5)
        found = cloud_of(KeySphere(0, 0, T, sphere), sphere, CloudParams(step=4, max_range_m=max_range_m))
        points = np.stack([found[name] for name in "xyz"], axis=1)
        assert len(points) == count
        np.testing.assert_allclose(np.linalg.norm(points - T.translation, axis=1), 5.0, rtol=1e-5)


# Lengths of a degree from tables of WGS 84: 110.574 and 111.320 km at the equator, 111.132 and 78.847 km at 45 deg
TABLE = [(0.0, 110574.3, 111319.5), (45.0, 111131.8, 78846.8)]


def test_meters_become_degrees():
    for latitude, per_latitude, per_longitude in TABLE:
        for heading in [0.0, 90.0, 30.0]:
            datum = Datum.parse(f"{latitude},10,{heading}")
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
