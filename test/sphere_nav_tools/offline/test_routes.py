"""A network in words: every column from numbers that differ, and what a car should be warned of."""

import math

import numpy as np
import pytest

from path_follower.path import Pose2
from path_follower.routes.network import EdgeCurve, Network, Node, RouteEdge
from path_follower.routes.planning import Leg, Route
from sphere_nav_tools.offline.routes import describe, describe_route, find_spot


def straight(length, y=0.0, speed=0.5):
    x = np.linspace(0.0, length, 101)
    return EdgeCurve(x, np.full(101, y), 0 * x, np.linspace(0.1, speed, 101))


def arc(radius):
    angle = np.linspace(0.0, 1.0, 101)
    return EdgeCurve(10 + radius * np.sin(angle), radius - radius * np.cos(angle), angle, np.full(101, math.nan))


@pytest.fixture
def network():
    edges = {
        5: RouteEdge(5, 1, 2, straight(10.0), 1.5, True, True, 0.0125, 3),
        6: RouteEdge(6, 2, 3, arc(2.3), 1.25, False, True),
        7: RouteEdge(7, 2, 4, arc(2.6)),
    }
    nodes = {number: Node(number, Pose2(10.0 * (number > 1), 0.0, 0.0)) for number in (1, 2, 3, 4)}
    return Network(nodes, edges, {"gate": 3, "barn": 1})


def test_a_network_in_lines(network):
    """A Cycab, 1.2 m between the axles and 0.45 rad of steering, drives circles of 2.48 m."""
    assert describe(network) == [
        "4 nodes, 3 edges, 14.9 m, map unknown",
        "edge   from     to  length  width  drives  speed  deviation  driven",
        "   5      1      2    10.0   1.50       3   0.50      0.013  both ways",
        "   6      2      3     2.3   1.25       1      -          -  backwards",
        "   7      2      4     2.6   0.00       1      -          -  forward",
        "place barn: node 1",
        "place gate: node 3",
        "edge 6: bends to 2.3 m radius; a Cycab cannot turn tighter than 2.5",
    ]


def test_a_way_in_lines(network):
    legs = Leg(5, 1, 2.0, 10.0), Leg(6, -1, 2.3, 1.0), Leg(6, 1, 1.0, 2.3), Leg(5, -1, 10.0, 0.0)
    assert describe_route(network, Route(legs, 41.4)) == [
        "edge    5      8.0 m",
        "edge   -6      1.3 m  backwards",
        "edge    6      1.3 m  gate",
        "edge   -5     10.0 m  backwards  barn",
        "20.6 m, 41 s",
    ]


def test_a_spot_is_the_closest_that_heads_as_asked_for():
    """Two roads side by side, and one across them."""
    x = np.linspace(-5.0, 5.0, 101)
    across = EdgeCurve(np.full(101, 4.0), x, np.full(101, math.pi / 2), np.ones(101))
    edges = {i: RouteEdge(i, 1, 2, curve) for i, curve in ((5, straight(10.0)), (6, straight(10.0, 1.0)), (7, across))}
    network = Network({1: Node(1, Pose2(0, 0, 0)), 2: Node(2, Pose2(10, 0, 0))}, edges)
    assert [find_spot(network, 2.0, y, None).edge for y in (-1.9, 0.4, 0.6, 2.9)] == [5, 5, 6, 6]
    assert find_spot(network, 3.8, 0.4, None).edge == 7
    assert find_spot(network, 3.8, 0.4, 0.1).edge == 5
    for y in (-2.1, 3.1):
        with pytest.raises(ValueError, match="expected a position within 2 m of the network, found 2, "):
            find_spot(network, 2.0, y, 0.0)
