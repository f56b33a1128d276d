import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph


def node(number, *position):
    return KeySphere(number, 1000 * number, SE3.from_parts(np.eye(3), position))


def ids(nodes):
    return [found.id for found in nodes]


LINE = [node(k, float(k), 0.0, 0.0) for k in range(10)]


def test_nearest_agrees_with_a_search_through_all_within_limits_of_number_and_distance():
    rng = np.random.default_rng(0)
    graph = SphereGraph([node(k, *rng.normal(size=3)) for k in range(200)])
    for point in rng.normal(size=(20, 3)):
        order = sorted(graph, key=lambda found: (np.linalg.norm(found.T_map_sphere.translation - point), found.id))
        assert ids(graph.nearest(point, 5)) == ids(order[:5])
        within = sorted(found.id for found in order if np.linalg.norm(found.T_map_sphere.translation - point) <= 0.5)
        assert ids(graph.near(point, 0.5)) == within
    graph = SphereGraph(LINE[:3])
    assert ids(graph.nearest([0, 0, 0], 10)) == [0, 1, 2]
    assert ids(graph.nearest([0, 0, 0], 10, max_distance_m=1.5)) == [0, 1]
    assert graph.nearest([50, 0, 0], 1, max_distance_m=1.0) == []
    assert SphereGraph().nearest([0, 0, 0]) == []
    assert SphereGraph().near([0, 0, 0], 1.0) == []


def test_with_poses_moves_some_and_keeps_the_rest():
    graph = SphereGraph(LINE[:2], [Edge(0, 1, SE3.identity(), np.eye(6))])
    moved = graph.with_poses({1: SE3.from_parts(np.eye(3), [7.0, 0, 0])})
    assert moved[1].T_map_sphere.translation[0] == 7.0
    assert moved[0] is not None
    assert moved.edges == graph.edges
    assert graph[1].T_map_sphere.translation[0] == 1.0


def test_what_does_not_fit_is_refused():
    graph, still = SphereGraph(LINE[:2]), SE3.identity()
    for ask, reason in [
        (lambda: graph.with_poses({1: SE3(np.full((4, 4), np.nan))}), "pose: expected finite"),
        (lambda: graph.add(LINE[1]), "expected a new id, found 1 again"),
        (lambda: graph.add(node(5, np.nan, 0.0, 0.0)), "pose: expected finite"),
        (lambda: graph.connect(Edge(0, 7, still, np.eye(6))), "edge 0-7: expected both ends in the graph, found no 7"),
        (lambda: Edge(0, 1, still, np.full((6, 6), np.inf)), "information: expected finite 6 x 6"),
    ]:
        with pytest.raises(ValueError, match=reason):
            ask()
