"""A network: where a pose is on it, places, parts of curves."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from path_follower.path import Pose2
from path_follower.routes.building import build_network
from path_follower.routes.network import Curve, Network, RouteEdge, Spot
from path_follower.routes.planning import plan, with_laps


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
    assert named.nodes[named.node_of("gate")].x == pytest.approx(5.0, abs=1e-6)
    assert len(named.edges) == len(fork.edges) + 1
    assert fork.with_place("gate", Spot(edge.id, 0.3)).places == {"home": edge.start, "gate": edge.start}
    assert named.name_of(named.node_of("gate")) == "gate"


def test_a_place_without_a_proper_name_is_refused(fork):
    with pytest.raises(ValueError, match="expected one of home, found 'gate'"):
        fork.node_of("gate")
    for name in ("", "a\nb", 65 * "x"):
        with pytest.raises(ValueError, match="expected a name of 1 to 64 printable characters"):
            fork.with_place(name, Spot(next(iter(fork.edges)), 5.0))


def test_a_part_of_a_curve_begins_and_ends_where_it_is_asked_to_and_bends_to_the_left(fork):
    curve = next(iter(fork.edges.values())).curve
    part = curve.part(1.234, 5.678)
    assert part.length == pytest.approx(4.444, abs=1e-6)
    assert (part.x[0], part.x[-1]) == (pytest.approx(1.234), pytest.approx(5.678))
    assert np.all(np.diff(part.x) > 0)
    angle = np.linspace(0.0, 1.0, 50)
    curve = Curve(4.0 * np.sin(angle), 4.0 - 4.0 * np.cos(angle), angle, np.ones(50))
    np.testing.assert_allclose(curve.bend, 0.25, rtol=1e-3)


def test_a_slow_teacher_counts_as_walking_and_an_unknown_speed_as_the_cruise():
    curve = Curve(np.array([0.0, 10.0, 16.0]), np.zeros(3), np.zeros(3), np.array([0.1, np.nan, 1.0]))
    edge = RouteEdge(1, 2, 3, curve)
    assert edge.seconds(2.0) == pytest.approx(2 * 10.0 / (0.3 + 2.0) + 2 * 6.0 / (2.0 + 1.0))


def test_a_vehicle_is_on_the_closest_of_several_edges_whichever_side_it_is_on():
    x = np.linspace(0.0, 20.0, 201)
    edges = {i: RouteEdge(i, 0, 1, Curve(x, np.full(201, y), 0 * x + turned, 0 * x + 1))
             for i, y, turned in ((5, 0.5, 0.0), (6, -0.4, 0.0), (7, -0.1, 0.5))}  # fmt: skip
    found = Network({0: Pose2(0, 0, 0), 1: Pose2(20, 0, 0)}, edges).locate(Pose2(10, 0, 0), 2.0, 0.6)
    assert [(spot.edge, spot.turned) for spot in found] == [(6, 0.0), (5, 0.0), (7, pytest.approx(-0.5))]
    assert [spot.left for spot in found[:2]] == pytest.approx([0.4, -0.5])


def straight(number, start, end, length, **more):
    """An edge of a length, wherever it lies."""
    x = np.linspace(0.0, length, 3)
    return RouteEdge(number, start, end, Curve(x, 0 * x, 0 * x, np.ones(3)), **more)


def random_network(rng, nodes=12, edges=40):
    pairs = rng.integers(0, nodes, (edges, 2))
    numbered = {100 + i: straight(100 + i, int(a), int(b), float(rng.uniform(1, 9))) for i, (a, b) in enumerate(pairs)}
    return Network({i: Pose2(0, 0, 0) for i in range(nodes)}, numbered)


def leads_on(network, route):
    """Each leg begins where the last one ends."""
    ends = []
    for leg in route.legs:
        edge = network.edges[leg.edge]
        ends.append((edge.start, edge.end) if leg.direction > 0 else (edge.end, edge.start))
    return all(before[1] == after[0] for before, after in pairwise(ends))


def test_no_way_is_quicker(rng):
    for _ in range(8):
        network = random_network(rng)
        costs = np.full((12, 12), np.inf)
        for edge in network.edges.values():
            costs[edge.start, edge.end] = min(costs[edge.start, edge.end], edge.length)
        best = dijkstra(csr_matrix(np.where(np.isfinite(costs), costs, 0.0)))
        for start, goal in rng.integers(0, 12, (10, 2)):
            if start == goal or not network.departures(start):
                continue
            spots = [Spot(edge.id, 0.0) for edge in network.departures(start)]
            goals = [Spot(edge.id, edge.length) for edge in network.arrivals(goal)]
            if np.isfinite(best[start, goal]):
                route = plan(network, spots, goals, cruise=1.0)
                assert route.seconds == pytest.approx(best[start, goal])
                assert leads_on(network, route)
            else:
                with pytest.raises(ValueError, match="no way"):
                    plan(network, spots, goals, cruise=1.0)


def test_a_closed_edge_is_not_driven(fork):
    home = Spot(next(iter(fork.edges)), 1.0)
    usual = plan(fork, [home], fork.spots_of(3), cruise=1.4)
    middle = usual.legs[1].edge
    other = plan(fork, [home], fork.spots_of(3), cruise=1.4, closed={middle})
    assert other.legs[1].edge != middle
    assert other.length > usual.length
    with pytest.raises(ValueError, match=f"here while {middle}, {other.legs[1].edge} are closed"):
        plan(fork, [home], fork.spots_of(3), cruise=1.4, closed={middle, other.legs[1].edge})
    with pytest.raises(ValueError, match=f"it stands on edge {home.edge}, which is closed"):
        plan(fork, [home], fork.spots_of(3), cruise=1.4, closed={home.edge})


def test_a_place_that_was_just_passed_is_reached(ring):
    (edge,) = ring.edges.values()
    assert plan(ring, [Spot(edge.id, 10.3)], [Spot(edge.id, 10.0)], cruise=1.0).length == 0.0
    assert plan(ring, [Spot(edge.id, 10.6)], [Spot(edge.id, 10.0)], cruise=1.0).length == pytest.approx(
        edge.length - 0.6
    )


def test_rounds_lead_back_to_where_they_begin(ring, fork):
    (edge,) = ring.edges.values()
    way = plan(ring, [Spot(edge.id, 5.0)], [Spot(edge.id, 20.0)], cruise=1.0)
    assert with_laps(ring, way, 0, cruise=1.0) is way
    three = with_laps(ring, way, 3, cruise=1.0)
    assert three.length == pytest.approx(15.0 + 3 * edge.length)
    home = plan(ring, [Spot(edge.id, 5.0)], ring.spots_of(edge.end), cruise=1.0)
    assert with_laps(ring, home, 2, cruise=1.0).length == pytest.approx(edge.length - 5.0 + 2 * edge.length)
    end = plan(fork, [Spot(next(iter(fork.edges)), 1.0)], fork.spots_of(3), cruise=1.0)
    with pytest.raises(ValueError, match="no way"):
        with_laps(fork, end, 1, cruise=1.0)


def test_backwards_only_where_allowed_and_never_when_forward_is_quicker(drive):
    network = build_network([drive((60, 0)), drive((20, 0), start=(20, 0, 0), direction=-1)])
    both = next(edge for edge in network.edges.values() if edge.is_reverse)
    back = plan(network, [Spot(both.id, 15.0)], network.spots_of(both.start), cruise=1.0)
    assert [(leg.edge, leg.direction, leg.first, leg.last) for leg in back.legs] == [(both.id, -1, 15.0, 0.0)]
    assert back.legs[0].name == f"-{both.id}"
    behind = network.departures(both.end)[0]
    with pytest.raises(ValueError, match="no way"):
        plan(network, [Spot(behind.id, 5.0)], network.spots_of(both.start), cruise=1.0)
    closed = plan(network, [Spot(both.id, 15.0)], network.spots_of(both.start), cruise=1.0, closed={both.id})
    assert closed.legs == back.legs  # a vehicle on a closed edge may leave it backwards


def test_a_change_of_direction_leads_through_a_node():
    """Forward past a node, then back into a side road: a three-point turn."""
    edges = [
        straight(10, 0, 1, 5.0),
        straight(11, 2, 1, 7.0, is_forward=False, is_reverse=True),
        straight(12, 2, 3, 4.0),
    ]
    network = Network({i: Pose2(0, 0, 0) for i in range(4)}, {edge.id: edge for edge in edges})
    route = plan(network, [Spot(10, 0.0)], [Spot(12, 4.0)], cruise=1.0)
    assert [leg.name for leg in route.legs] == ["10", "-11", "12"]
    assert math.isclose(route.seconds, 16.0)
    for length, names in ((34.0, ["10", "13"]), (36.0, ["10", "-11", "12"])):
        around = straight(13, 1, 3, length)  # 5 s more; the turn counts 5 + 3 * 7 + 4 s, and 5 s for each change
        both = Network(network.nodes, {**network.edges, 13: around})
        assert [leg.name for leg in plan(both, [Spot(10, 0.0)], both.spots_of(3), cruise=1.0).legs] == names
