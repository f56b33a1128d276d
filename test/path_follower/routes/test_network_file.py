"""The file of a network: nothing is lost, Route Server's rules are kept, what is no network is refused in one line."""

import json
import math

import numpy as np
import pytest

from path_follower.path import Pose2
from path_follower.routes.building import build_network
from path_follower.routes.network import EdgeCurve, Network, Node, RouteEdge, Spot
from path_follower.routes.network_file import from_geojson, network_path, read_network, to_geojson, write_network


@pytest.fixture
def named(fork):
    return fork.with_place("gate", Spot(next(iter(fork.edges)), 5.0))


def test_a_network_comes_back_as_it_was(named, tmp_path):
    write_network(tmp_path / "routes.geojson", named)
    assert [path.name for path in tmp_path.iterdir()] == ["routes.geojson"]
    found = read_network(network_path(tmp_path), "campus")
    assert (found.places, found.map_id, found.frame) == (named.places, "campus", "map")
    assert list(found.nodes) == list(named.nodes)
    for edge in named.edges.values():
        other = found.edges[edge.id]
        assert (other.start, other.end, other.is_forward, other.is_reverse) == (edge.start, edge.end, True, False)
        assert (other.num_drives, math.isnan(other.deviation)) == (edge.num_drives, True)
        for name in ("x", "y", "yaw", "speed"):
            np.testing.assert_allclose(getattr(other.curve, name), getattr(edge.curve, name), atol=1e-4)


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
    twins = [f["properties"] for f in lines if "twin_of" in f["properties"]]
    assert [(t["startid"], t["endid"]) for t in twins] == [
        (e.end, e.start) for e in network.edges.values() if e.is_reverse
    ]
    assert (
        from_geojson(json.dumps({"features": features, **json.loads(to_geojson(network))})).edges.keys()
        == network.edges.keys()
    )


def test_what_is_known_of_an_edge_comes_back_however_it_may_be_driven():
    """An edge that is only driven backwards is a line from its end to its start for others."""
    x = np.linspace(0.0, 3.1, 32)
    curve = EdgeCurve(x, 0.1 * x, np.full(32, 0.0997), np.where(x > 2.0, np.nan, 0.5 + 0.1 * x))
    ways = {10: (True, False), 11: (True, True), 12: (False, True)}
    edges = {i: RouteEdge(i, 1, 2, curve, 1.25, *way, deviation=0.0125, num_drives=4) for i, way in ways.items()}
    nodes = {1: Node(1, Pose2(0.0, 0.0, 0.0997)), 2: Node(2, Pose2(3.1, 0.31, 0.0997))}
    text = to_geojson(Network(nodes, edges, {"gate": 2}, "campus", "hall"))
    found = from_geojson(text)
    assert (found.places, found.frame) == ({"gate": 2}, "hall")
    for i, edge in found.edges.items():
        assert (edge.start, edge.end, edge.is_forward, edge.is_reverse) == (1, 2, *ways[i])
        assert (edge.width, edge.deviation, edge.num_drives) == (1.25, 0.0125, 4)
        np.testing.assert_allclose(edge.curve.speed, curve.speed, atol=1e-4)
    lines = {f["properties"]["id"]: f for f in json.loads(text)["features"] if f["geometry"]["type"] != "Point"}
    ends = {i: (line["properties"]["startid"], line["properties"]["endid"]) for i, line in lines.items()}
    assert ends == {10: (1, 2), 11: (1, 2), 12: (2, 1), 13: (2, 1)}  # the last one is the twin of 11
    assert lines[13]["properties"]["twin_of"] == 11
    assert lines[13]["geometry"]["coordinates"][0] == lines[11]["geometry"]["coordinates"][0][::-1]
    (shown,) = lines[10]["geometry"]["coordinates"]
    assert [point[0] for point in shown] == [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.1]
    assert lines[10]["properties"]["metadata"]["abs_speed_limit"] == 0.7
    assert lines[10]["properties"]["cost"] == pytest.approx(edges[10].seconds(2.0), abs=1e-3)


def test_another_map_is_refused(named, tmp_path):
    write_network(tmp_path / "routes.geojson", named)
    with pytest.raises(
        ValueError, match=r"routes.geojson: network.map_id: expected that of the map, hall, found campus"
    ):
        read_network(tmp_path / "routes.geojson", "hall")


def edge_of(whole):
    return next(f for f in whole["features"] if f["geometry"]["type"] == "MultiLineString")["properties"]


BROKEN = {
    "network.version: expected a value": lambda w: w["network"].pop("version"),
    "expected format 'sphere_nav routes' version 1": lambda w: w["network"].update(version=2),
    "network: expected a value": lambda w: w.pop("network"),
    "features: expected a list": lambda w: w.update(features={}),
    "expected nodes and edges, found": lambda w: w.update(features=[]),
    "expected a number that is not taken": lambda w: w["features"].append(w["features"][0]),
    "expected a whole number from 0": lambda w: w["features"][0]["properties"].update(id=-1),
    "names: expected names": lambda w: w["features"][0]["properties"].update(names=[5]),
    "yaw: expected a finite number": lambda w: w["features"][0]["properties"].pop("yaw"),
    "expected columns of one length": lambda w: edge_of(w)["curve"]["x"].pop(),
    "expected points at most 1.0 m apart": lambda w: edge_of(w)["curve"]["x"].__setitem__(5, 99.0),
    "curve.yaw: expected a finite number": lambda w: edge_of(w)["curve"]["yaw"].__setitem__(5, "nan"),
    "expected nodes that exist, found 999": lambda w: edge_of(w).update(endid=999),
    "expected its curve to end at node": lambda w: edge_of(w).update(endid=edge_of(w)["startid"]),
    "metadata.width: expected a value": lambda w: edge_of(w)["metadata"].pop("width"),
    "expected a short text": lambda w: w["network"].update(map_id="x\ny"),
}


def test_what_is_no_network_is_refused_in_one_line(named):
    for text in BROKEN:
        whole = json.loads(to_geojson(named))
        BROKEN[text](whole)
        with pytest.raises(ValueError, match=text.replace("(", r"\(")) as error:
            from_geojson(json.dumps(whole), "routes.geojson")
        assert "\n" not in str(error.value)
        assert str(error.value).startswith("routes.geojson")
