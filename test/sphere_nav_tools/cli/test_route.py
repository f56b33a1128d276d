"""The command `route`: from files of drives to a network, a place, a way, its words and its picture."""

import json
import math

import numpy as np
import pytest
from matplotlib.pyplot import imread

from path_follower.path import Pose2
from path_follower.routes.network import Curve, Network, RouteEdge
from path_follower.routes.network_file import read_network
from sphere_nav_tools.cli.main import main
from sphere_nav_tools.offline.routes import describe, find_spot


@pytest.fixture
def drives(tmp_path, monkeypatch):
    """A road of 60 m, and a drive that turns off it after 30 m."""
    monkeypatch.chdir(tmp_path)
    arc = np.linspace(0, np.pi / 2, 95)
    along = np.stack([np.arange(0, 30, 0.1), 0 * np.arange(0, 30, 0.1)], axis=-1)
    off = np.concatenate([along, np.stack([30 + 6 * np.sin(arc), 6 - 6 * np.cos(arc)], axis=-1)[1:]])
    for name, points in (("a", np.stack([np.arange(0, 60, 0.1), np.zeros(600)], axis=-1)), ("b", off)):
        rows = "\n".join(f"{x:.4f},{y:.4f}" for x, y in points)
        (tmp_path / f"{name}.csv").write_text(f"# map_id: campus\nx,y\n{rows}\n")
    return tmp_path


def run(capsys, *words):
    status = main(["route", *words])
    return status, capsys.readouterr()


def test_a_dry_run_tells_of_the_network_and_writes_only_its_picture(drives, capsys):
    status, said = run(capsys, "build", "net.geojson", "a.csv", "b.csv", "--dry-run", "--plot", "net.png")
    assert status == 0
    assert "4 nodes, 3 edges" in said.out
    assert "net.geojson: not written (--dry-run)" in said.out
    assert sorted(path.name for path in drives.iterdir()) == ["a.csv", "b.csv", "net.png"]
    assert imread("net.png").std() > 0.05


def test_places_that_are_named_are_ends_of_ways(drives, capsys):
    assert run(capsys, "build", "net.geojson", "a.csv", "b.csv")[0] == 0
    status, said = run(capsys, "name", "gate", "net.geojson", "--at", "50,0.5")
    assert (status, "gate is node" in said.out) == (0, True)
    assert run(capsys, "name", "yard", "net.geojson", "--at", "36,4,90")[0] == 0
    network = read_network("net.geojson")
    assert sorted(network.places) == ["gate", "home", "yard"]
    assert network.nodes[network.places["yard"]].y == pytest.approx(4.0, abs=0.2)
    status, said = run(capsys, "show", "net.geojson", "--plot", "net.png")
    assert (status, f"place gate: node {network.places['gate']}" in said.out) == (0, True)
    status, said = run(capsys, "plan", "net.geojson", "home", "gate", "--plot", "way.png")
    assert (status, "50.0 m" in said.out) == (0, True)
    status, said = run(capsys, "plan", "net.geojson", "gate", "home")
    assert (status, said.out.strip()) == (1, "no way: no edges lead there from here")
    assert run(capsys, "export", "net.geojson", "-o", "way.csv", "--from", "home", "--to", "yard")[0] == 0
    assert len((drives / "way.csv").read_text().splitlines()) == pytest.approx(378, abs=10)
    assert run(capsys, "export", "net.geojson", "-o", "lean.geojson")[0] == 0
    assert all("curve" not in f["properties"] for f in json.loads((drives / "lean.geojson").read_text())["features"])


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("build", "net.geojson", "a.csv", "d.csv"), "d.csv: map_id: expected campus, found hall"),
        (("build", "old.geojson", "a.csv"), "old.geojson: expected no such file, found one: --overwrite"),
        (("name", "gate", "good.geojson", "--at", "500,0"), "--at: expected a position within 2 m"),
        (("plan", "good.geojson", "home", "home", "--closed", "99"), "--closed: expected edges of the network, found"),
    ],
)
def test_a_network_place_or_way_that_cannot_be_is_refused_in_one_line(drives, capsys, words, text):
    (drives / "old.geojson").write_text("no network")
    (drives / "d.csv").write_text((drives / "a.csv").read_text().replace("campus", "hall"))
    assert run(capsys, "build", "good.geojson", "a.csv")[0] == 0
    status, said = run(capsys, *words)
    assert status == 2
    assert said.err.startswith(f"sphere_nav route: {text}")
    assert said.err.count("\n") == 1


def straight(length, y=0.0):
    x = np.linspace(0.0, length, 101)
    return Curve(x, np.full(101, y), 0 * x, np.linspace(0.1, 0.5, 101))


def arc(radius):
    angle = np.linspace(0.0, 1.0, 101)
    return Curve(10 + radius * np.sin(angle), radius - radius * np.cos(angle), angle, np.full(101, math.nan))


@pytest.fixture
def network():
    edges = {
        5: RouteEdge(5, 1, 2, straight(10.0), True, True),
        6: RouteEdge(6, 2, 3, arc(2.3), False, True),
        7: RouteEdge(7, 2, 4, arc(2.6)),
    }
    nodes = {number: Pose2(10.0 * (number > 1), 0.0, 0.0) for number in (1, 2, 3, 4)}
    return Network(nodes, edges, {"gate": 3, "barn": 1})


def test_a_network_in_lines(network):
    assert describe(network) == [
        "4 nodes, 3 edges, 14.9 m, map unknown",
        "edge  from  to  length  speed  driven",
        "   5     1   2  10.0    0.50   both ways",
        "   6     2   3  2.3     -      backwards",
        "   7     2   4  2.6     -      forward",
        "place barn: node 1",
        "place gate: node 3",
    ]


def test_a_spot_is_the_closest_that_heads_as_asked_for():
    """Two roads side by side, and one across them."""
    x = np.linspace(-5.0, 5.0, 101)
    across = Curve(np.full(101, 4.0), x, np.full(101, math.pi / 2), np.ones(101))
    edges = {i: RouteEdge(i, 1, 2, curve) for i, curve in ((5, straight(10.0)), (6, straight(10.0, 1.0)), (7, across))}
    network = Network({1: Pose2(0, 0, 0), 2: Pose2(10, 0, 0)}, edges)
    assert [find_spot(network, 2.0, y).edge for y in (-1.9, 0.4, 0.6, 2.9)] == [5, 5, 6, 6]
    assert find_spot(network, 3.8, 0.4).edge == 7
    assert find_spot(network, 3.8, 0.4, 0.1).edge == 5
    for y in (-2.1, 3.1):
        with pytest.raises(ValueError, match="expected a position within 2 m of the network, found 2, "):
            find_spot(network, 2.0, y, 0.0)
