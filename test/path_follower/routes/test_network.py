"""A network: where a pose is on it, places, parts of curves."""

import math

import numpy as np
import pytest

from path_follower.path import Pose2
from path_follower.routes.network import EdgeCurve, Network, Node, RouteEdge, Spot


def test_a_pose_is_located_by_position_and_heading(fork):
    spots = fork.locate(Pose2(5.0, 0.4, 0.1), 1.0, 0.35)
    assert [spot.edge for spot in spots] == [fork.departures(fork.places["home"])[0].id]
    assert (spots[0].s, spots[0].left, spots[0].turned) == (
        pytest.approx(5.0, abs=0.1),
        pytest.approx(0.4),
        pytest.approx(0.1),
    )
    assert fork.locate(Pose2(5.0, 1.1, 0.0), 1.0, 0.35) == []
    assert fork.locate(Pose2(5.0, 0.0, 0.5), 1.0, 0.35) == []
    assert fork.locate(Pose2(5.0, 0.0, math.pi), 1.0, 0.35) == []
    assert fork.locate(Pose2(-0.9, 0.0, 0.0), 1.0, 0.35)[0].s == 0.0
    assert fork.locate(Pose2(-1.1, 0.0, 0.0), 1.0, 0.35) == []


def test_a_place_cuts_its_edge_or_takes_a_node_that_is_there(fork):
    edge = next(iter(fork.edges.values()))
    named = fork.with_place("gate", Spot(edge.id, 5.0))
    before, after = named.arrivals(named.node_of("gate"))[0], named.departures(named.node_of("gate"))[0]
    assert before.length + after.length == pytest.approx(edge.length, abs=1e-6)
    assert named.nodes[named.node_of("gate")].pose.x == pytest.approx(5.0, abs=1e-6)
    assert len(named.edges) == len(fork.edges) + 1
    assert fork.with_place("gate", Spot(edge.id, 0.3)).places == {"home": edge.start, "gate": edge.start}
    assert named.name_of(named.node_of("gate")) == "gate"


def test_what_is_no_place(fork):
    with pytest.raises(ValueError, match="expected one of home, found 'gate'"):
        fork.node_of("gate")
    for name in ("", "a\nb", 65 * "x"):
        with pytest.raises(ValueError, match="expected a name of 1 to 64 printable characters"):
            fork.with_place(name, Spot(next(iter(fork.edges)), 5.0))


def test_a_part_of_a_curve_begins_and_ends_where_it_is_asked_to(fork):
    curve = next(iter(fork.edges.values())).curve
    part = curve.part(1.234, 5.678)
    assert part.length == pytest.approx(4.444, abs=1e-6)
    assert (part.x[0], part.x[-1]) == (pytest.approx(1.234), pytest.approx(5.678))
    assert np.all(np.diff(part.x) > 0)


def test_the_time_of_an_edge_goes_by_what_was_driven(drive, fork):
    edge = next(iter(fork.edges.values()))
    assert edge.seconds(2.0) == pytest.approx(edge.length / 1.4, rel=0.01)
    assert edge.seconds(0.7) == pytest.approx(edge.length / 0.7, rel=0.01)


def test_a_slow_teacher_counts_as_walking_and_an_unknown_speed_as_the_cruise():
    curve = EdgeCurve(np.array([0.0, 10.0, 16.0]), np.zeros(3), np.zeros(3), np.array([0.1, np.nan, 1.0]))
    edge = RouteEdge(1, 2, 3, curve)
    assert edge.seconds(2.0) == pytest.approx(2 * 10.0 / (0.3 + 2.0) + 2 * 6.0 / (2.0 + 1.0))


def test_a_curve_bends_to_the_left():
    angle = np.linspace(0.0, 1.0, 50)
    curve = EdgeCurve(4.0 * np.sin(angle), 4.0 - 4.0 * np.cos(angle), angle, np.ones(50))
    np.testing.assert_allclose(curve.bend, 0.25, rtol=1e-3)


def test_the_closest_of_several_edges_comes_first_whichever_side_it_is_on():
    x = np.linspace(0.0, 20.0, 201)
    edges = {i: RouteEdge(i, 0, 1, EdgeCurve(x, np.full(201, y), 0 * x + turned, 0 * x + 1))
             for i, y, turned in ((5, 0.5, 0.0), (6, -0.4, 0.0), (7, -0.1, 0.5))}  # fmt: skip
    found = Network({0: Node(0, Pose2(0, 0, 0)), 1: Node(1, Pose2(20, 0, 0))}, edges).locate(Pose2(10, 0, 0), 2.0, 0.6)
    assert [(spot.edge, spot.turned) for spot in found] == [(6, 0.0), (5, 0.0), (7, pytest.approx(-0.5))]
    assert [spot.left for spot in found[:2]] == pytest.approx([0.4, -0.5])


def test_a_place_within_half_a_metre_of_a_node_is_there(fork):
    for from_end, number in [(0.4, 0), (0.6, 1)]:
        edge = next(iter(fork.edges.values()))
        for s, node in ((from_end, edge.start), (edge.length - from_end, edge.end)):
            named = fork.with_place("gate", Spot(edge.id, s))
            assert len(named.edges) == len(fork.edges) + number
            assert (named.places["gate"] == node) == (number == 0)
