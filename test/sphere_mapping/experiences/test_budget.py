"""What leaves a map that holds too much."""

from itertools import pairwise

import numpy as np
import pytest

from sphere_mapping.experiences.budget import thin
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


def left(graph, num_experiences, *, is_whole=True):
    found = thin(graph, num_experiences, is_whole=is_whole)
    return graph.nodes.keys() - found.nodes.keys()


def test_what_served_least_leaves_and_the_graph_stays_whole(graph):
    found = thin(graph, 2, is_whole=True)
    assert [node.id for node in found] == [0, 2, 10, 11, 20]
    assert len(found.edges) == 4
    for edge in found.edges:
        expected = found[edge.a].T_map_sphere.inverse() @ found[edge.b].T_map_sphere
        assert expected.distance(edge.T_a_b)[0] < 1e-9


def test_the_only_one_of_a_place_stays_whatever_it_served(graph):
    assert left(graph, 1) == {1, 2, 10}


def test_views_elsewhere_are_other_places_of_partial_spheres():
    turned = SE3.from_planar(0.0, 0.0, 1.5)
    nodes = [KeySphere(0, 0, SE3.identity(), None, 4.0, DAY), KeySphere(1, 1, turned, None, 4.0, NIGHT)]
    assert not left(SphereGraph(nodes), 1, is_whole=False)
    assert left(SphereGraph(nodes), 1) == {0}
