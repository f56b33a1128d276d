"""What leaves a map that holds too much."""

from itertools import pairwise

import numpy as np
import pytest

from sphere_mapping.experiences.budget import Budget, thin
from sphere_nav.geometry import SE3
from sphere_nav.spheres.graph import Edge, Experience, KeySphere, SphereGraph

DAY, DUSK, NIGHT = Experience("day"), Experience("dusk"), Experience("night", stamp_ns=5)


def place(first_id, x, *served):
    """Return key spheres of one place: of day, dusk and night, as far as there are figures."""
    parts = zip((DAY, DUSK, NIGHT), served, strict=False)
    pose = SE3.from_planar(x, 0.0, 0.0)
    return [KeySphere(first_id + k, k, pose, None, 4.0, part, number) for k, (part, number) in enumerate(parts)]


@pytest.fixture
def graph():
    nodes = [*place(0, 0.0, 50.0, 3.0, 20.0), *place(10, 20.0, 2.0, 9.0), *place(20, 40.0, 0.0)]
    edges = [Edge(a.id, b.id, a.T_map_sphere.inverse() @ b.T_map_sphere, np.eye(6)) for a, b in pairwise(nodes)]
    return SphereGraph(nodes, edges)


def alike(sphere_id, is_condensed):
    return 1e6


def left(graph, budget, count_bytes=alike, *, is_whole=True):
    found = thin(graph, budget, count_bytes, is_whole=is_whole)
    leaving = graph.nodes.keys() - found.graph.nodes.keys()
    assert found.num_left == len(leaving)
    assert found.condensed <= found.graph.nodes.keys()
    return leaving


def test_what_served_least_leaves_and_the_graph_stays_whole(graph):
    found = thin(graph, Budget.parse("2"), alike, is_whole=True)
    assert not found.condensed
    assert [node.id for node in found.graph] == [0, 2, 10, 11, 20]
    assert len(found.graph.edges) == 4
    for edge in found.graph.edges:
        expected = found.graph[edge.a].T_map_sphere.inverse() @ found.graph[edge.b].T_map_sphere
        assert expected.distance(edge.T_a_b)[0] < 1e-9


def test_the_only_one_of_a_place_stays_whatever_it_served(graph):
    assert left(graph, Budget.parse("1")) == {1, 2, 10}
    assert left(graph, Budget(num_bytes=1.0)) == {1, 2, 10}


def test_bytes_are_saved_before_any_key_sphere_leaves(graph):
    """By service: 20 (0 images), 10 (2), 1 (3), 11 (9), 2 (20), 0 (50)."""

    def count(sphere_id, is_condensed):
        return 0.4e6 if is_condensed else 1e6

    assert not thin(graph, Budget(num_bytes=6e6), count, is_whole=True).condensed
    found = thin(graph, Budget(num_bytes=4.9e6), count, is_whole=True)
    assert (found.num_left, found.condensed) == (0, {20, 10})
    found = thin(graph, Budget(num_bytes=2.4e6), count, is_whole=True)
    assert (found.num_left, found.condensed) == (0, {0, 1, 2, 10, 11, 20})
    found = thin(graph, Budget(num_bytes=1.7e6), count, is_whole=True)
    assert (found.num_left, found.condensed) == (2, {0, 2, 11, 20})


def test_views_elsewhere_are_other_places_of_partial_spheres():
    turned = SE3.from_planar(0.0, 0.0, 1.5)
    nodes = [KeySphere(0, 0, SE3.identity(), None, 4.0, DAY), KeySphere(1, 1, turned, None, 4.0, NIGHT)]
    assert not left(SphereGraph(nodes), Budget(1), is_whole=False)
    assert left(SphereGraph(nodes), Budget(1)) == {0}


def test_a_budget_is_a_number_of_experiences_or_megabytes():
    for text, budget in [("3", Budget(3)), ("200MB", Budget(num_bytes=200e6)), (" 17.5MB ", Budget(num_bytes=17.5e6))]:
        assert Budget.parse(text) == budget
