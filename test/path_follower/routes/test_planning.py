"""The quickest way: as an independent Dijkstra finds it, over open edges, with rounds, in reverse where allowed."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from path_follower.path import Pose2
from path_follower.routes.building import build_network
from path_follower.routes.network import EdgeCurve, Network, Node, RouteEdge, Spot
from path_follower.routes.planning import plan, with_laps


def straight(number, start, end, length, **more):
    """An edge of a length, wherever it lies."""
    x = np.linspace(0.0, length, 3)
    return RouteEdge(number, start, end, EdgeCurve(x, 0 * x, 0 * x, np.ones(3)), **more)


def random_network(rng, nodes=12, edges=40):
    pairs = rng.integers(0, nodes, (edges, 2))
    numbered = {100 + i: straight(100 + i, int(a), int(b), float(rng.uniform(1, 9))) for i, (a, b) in enumerate(pairs)}
    return Network({i: Node(i, Pose2(0, 0, 0)) for i in range(nodes)}, numbered)


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
    with pytest.raises(
        ValueError, match=f"no edges lead there from here while {middle}, {other.legs[1].edge} are closed"
    ):
        plan(fork, [home], fork.spots_of(3), cruise=1.4, closed={middle, other.legs[1].edge})
    with pytest.raises(
        ValueError, match=f"it stands on edge {home.edge}, which is closed and may not be left backwards"
    ):
        plan(fork, [home], fork.spots_of(3), cruise=1.4, closed={home.edge})
    with pytest.raises(ValueError, match="expected a start on the network, found none"):
        plan(fork, [], fork.spots_of(3), cruise=1.4)


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
    network = Network({i: Node(i, Pose2(0, 0, 0)) for i in range(4)}, {edge.id: edge for edge in edges})
    route = plan(network, [Spot(10, 0.0)], [Spot(12, 4.0)], cruise=1.0)
    assert [leg.name for leg in route.legs] == ["10", "-11", "12"]
    assert math.isclose(route.seconds, 16.0)
    for length, names in ((34.0, ["10", "13"]), (36.0, ["10", "-11", "12"])):
        around = straight(13, 1, 3, length)  # 5 s more; the turn counts 5 + 3 * 7 + 4 s, and 5 s for each change
        both = Network(network.nodes, {**network.edges, 13: around})
        assert [leg.name for leg in plan(both, [Spot(10, 0.0)], both.spots_of(3), cruise=1.0).legs] == names
