"""Networks and drives in files: nothing is lost, and what is none is refused in one line."""

import json
import re

import numpy as np
import pytest

from path_follower.params import FollowerParams
from path_follower.path import Pose2
from path_follower.path_files import read_drives, read_path, write_course
from path_follower.routes.building import build_network
from path_follower.routes.network import Curve, Network, RouteEdge, Spot
from path_follower.routes.network_file import from_geojson, network_path, read_network, to_geojson, write_network
from path_follower.routes.planning import make_course, plan
from sphere_nav.geometry.trajectory import read_map_id


def test_route_server_finds_what_it_wants(drive):
    """As nav2_route's GeoJsonGraphFileLoader reads: Points with id, lines with id, startid and endid of nodes."""
    network = build_network([drive((60, 0)), drive((20, 0), start=(20, 0, 0), direction=-1)], "campus")
    features = json.loads(to_geojson(network))["features"]
    points = [f for f in features if f["geometry"]["type"] == "Point"]
    lines = [f for f in features if f["geometry"]["type"] == "MultiLineString"]
    assert len(points) + len(lines) == len(features)
    numbers = [f["properties"]["id"] for f in features]
    assert len(set(numbers)) == len(numbers)
    nodes = {f["properties"]["id"] for f in points}
    assert all({f["properties"]["startid"], f["properties"]["endid"]} <= nodes for f in lines)
    assert all(len(f["geometry"]["coordinates"]) == 2 and f["properties"]["frame"] == "map" for f in points)
    flat = [value for f in lines for value in f["properties"]["metadata"].values()]
    assert all(isinstance(value, bool | int | float | str) for value in flat)


def test_a_network_comes_back_from_its_file_however_its_edges_may_be_driven(tmp_path):
    """An edge that is only driven backwards is a line from its end to its start for others."""
    x = np.linspace(0.0, 3.1, 32)
    curve = Curve(x, 0.1 * x, np.full(32, 0.0997), np.where(x > 2.0, np.nan, 0.5 + 0.1 * x))
    ways = {10: (True, False), 11: (True, True), 12: (False, True)}
    edges = {i: RouteEdge(i, 1, 2, curve, *way) for i, way in ways.items()}
    nodes = {1: Pose2(0.0, 0.0, 0.0997), 2: Pose2(3.1, 0.31, 0.0997)}
    write_network(tmp_path / "routes.geojson", Network(nodes, edges, {"gate": 2}, "campus"))
    found, text = read_network(network_path(tmp_path)), (tmp_path / "routes.geojson").read_text()
    assert (found.nodes, found.places, found.map_id) == (nodes, {"gate": 2}, "campus")
    for i, edge in found.edges.items():
        assert (edge.start, edge.end, edge.is_forward, edge.is_reverse) == (1, 2, *ways[i])
        np.testing.assert_allclose(edge.curve.columns, curve.columns, atol=1e-4)
    lines = {f["properties"]["id"]: f for f in json.loads(text)["features"] if f["geometry"]["type"] != "Point"}
    ends = {i: (line["properties"]["startid"], line["properties"]["endid"]) for i, line in lines.items()}
    assert ends == {10: (1, 2), 11: (1, 2), 12: (2, 1), 13: (2, 1)}  # the last one is the twin of 11
    assert lines[13]["properties"]["twin_of"] == 11
    assert lines[13]["geometry"]["coordinates"][0] == lines[11]["geometry"]["coordinates"][0][::-1]
    (shown,) = lines[10]["geometry"]["coordinates"]
    assert [point[0] for point in shown] == [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.1]
    assert lines[10]["properties"]["metadata"]["abs_speed_limit"] == 0.7
    assert lines[10]["properties"]["cost"] == pytest.approx(edges[10].seconds(2.0), abs=1e-3)


def edge_of(whole):
    return next(f for f in whole["features"] if f["geometry"]["type"] == "MultiLineString")["properties"]


BROKEN = {
    "expected format 'sphere_nav routes' version 1": lambda w: w["network"].update(version=2),
    "expected a number that is not taken": lambda w: w["features"].append(w["features"][0]),
    "expected points at most 1.0 m apart": lambda w: edge_of(w)["curve"]["x"].__setitem__(5, 99.0),
    "expected nodes that exist, found 999": lambda w: edge_of(w).update(endid=999),
    "expected its curve to end at node": lambda w: edge_of(w).update(endid=edge_of(w)["startid"]),
}


def test_a_file_that_is_no_network_is_refused_in_one_line(fork):
    for text in BROKEN:
        whole = json.loads(to_geojson(fork))
        BROKEN[text](whole)
        with pytest.raises(ValueError, match=re.escape(text)) as error:
            from_geojson(json.dumps(whole), "routes.geojson")
        assert "\n" not in str(error.value)
        assert str(error.value).startswith("routes.geojson")


def test_a_course_is_what_the_follower_reads(fork, tmp_path):
    route = plan(fork, [Spot(min(fork.edges), 1.0)], fork.spots_of(3), cruise=1.0)
    points = make_course(fork, route)
    points[:50, 3] = np.nan
    write_course(tmp_path / "course.csv", points, "campus")
    path = read_path(tmp_path / "course.csv", FollowerParams())
    assert read_map_id(tmp_path / "course.csv") == "campus"
    assert path.length == pytest.approx(route.length, abs=0.05)
    assert path.possible[10] == pytest.approx(FollowerParams().vehicle.max_speed, abs=0.1)


def write_csv(path, poses):
    rows = [f"{x:.4f},{y:.4f},{yaw:.5f},0.8" for x, y, yaw in poses]
    path.write_text("\n".join(["# map_id: campus", "x,y,yaw,speed", *rows]))
    return path


def test_a_drive_forward_and_back_is_two_drives_and_so_is_a_reversible_one(tmp_path, kit):
    file = write_csv(tmp_path / "d.csv", kit.course((10, 0), (-6, 0.1)))
    drives, map_id = read_drives(file, FollowerParams())
    assert map_id == "campus"
    assert [drive.direction for drive in drives] == [1, -1]
    assert [drive.curve.length for drive in drives] == [pytest.approx(10, abs=0.1), pytest.approx(6, abs=0.1)]
    for drive in drives:  # in the order in which the vehicle heads
        ahead = np.diff(drive.curve.x) * np.cos(drive.curve.yaw[:-1]) + np.diff(drive.curve.y) * np.sin(
            drive.curve.yaw[:-1]
        )
        assert (ahead > 0).all()
        assert drive.curve.speed == pytest.approx(0.8)
    drives, _ = read_drives(write_csv(tmp_path / "d.csv", kit.course((10, 0))), FollowerParams(), is_reversible=True)
    assert [drive.direction for drive in drives] == [1, -1]
