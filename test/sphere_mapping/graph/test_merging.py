import numpy as np
import pytest

from sphere_mapping.graph.merging import compose_edges, merge, reverse
from sphere_nav.geometry import SE3
from sphere_nav.spheres.graph import Edge, Experience, KeySphere, SphereGraph

STEP = 1e-6
NOWHERE = np.zeros((0, 3))


def random_edge(rng, a, b):
    root = rng.normal(size=(6, 6))
    covariance = 1e-4 * (root @ root.T + np.eye(6))
    information = np.linalg.inv(covariance)
    return Edge(a, b, SE3.exp(rng.normal(size=6)), (information + information.T) / 2)


def jacobian(function):
    """Return d function / d x at 0 (6, 6), central differences."""
    return np.stack([(function(x) - function(-x)) / (2 * STEP) for x in STEP * np.eye(6)], axis=1)


def test_a_composed_edge_is_the_product_with_the_covariance_of_the_product(rng):
    first, second = random_edge(rng, 1, 2), random_edge(rng, 2, 3)
    found, T = compose_edges(first, second), first.T_a_b @ second.T_a_b
    assert (found.a, found.b) == (1, 3)
    np.testing.assert_allclose(found.T_a_b.matrix, T.matrix, atol=1e-12)
    by_first = jacobian(lambda x: (T.inverse() @ first.T_a_b @ SE3.exp(x) @ second.T_a_b).log())
    by_second = jacobian(lambda y: (T.inverse() @ first.T_a_b @ second.T_a_b @ SE3.exp(y)).log())
    expected = sum(J @ np.linalg.inv(edge.information) @ J.T for J, edge in ((by_first, first), (by_second, second)))
    np.testing.assert_allclose(np.linalg.inv(found.information), expected, rtol=1e-5, atol=1e-9)


def test_an_edge_from_its_other_end_says_the_same(rng):
    edge = random_edge(rng, 1, 2)
    back = reverse(edge)
    J = jacobian(lambda x: (edge.T_a_b @ (edge.T_a_b @ SE3.exp(x)).inverse()).log())
    np.testing.assert_allclose(np.linalg.inv(back.information), J @ np.linalg.inv(edge.information) @ J.T, rtol=1e-5)
    again = reverse(back)
    np.testing.assert_allclose(again.T_a_b.matrix, edge.T_a_b.matrix, atol=1e-12)
    np.testing.assert_allclose(again.information, edge.information, rtol=1e-9)


def line(*positions, regions=None, loops=()):
    regions = regions or [4.0] * len(positions)
    nodes = [
        KeySphere(k, k, SE3.from_parts(np.eye(3), [x, 0.0, 0.0]), region_radius_m=radius)
        for k, (x, radius) in enumerate(zip(positions, regions, strict=True))
    ]

    def joined(a, b, is_loop):
        return Edge(a, b, nodes[a].T_map_sphere.inverse() @ nodes[b].T_map_sphere, 1e4 * np.eye(6), is_loop)

    chain = [joined(k, k + 1, False) for k in range(len(nodes) - 1)]
    return SphereGraph(nodes, chain + [joined(a, b, True) for a, b in loops])


def test_the_newer_of_two_spheres_of_a_place_leaves_and_its_edges_are_composed():
    graph = line(0.0, 2.0, 4.0, 2.2, 0.3, loops=[(1, 3), (0, 4)])
    merged = merge(graph, np.zeros((0, 3)))
    assert list(merged.nodes) == [0, 1, 2]
    # 4 left: 3-0 through 4; then 3: 2-1 and 0-1 through 3
    assert [(edge.a, edge.b) for edge in merged.edges if edge.is_loop] == [(1, 0), (1, 2)]
    for edge in merged.edges:
        expected = graph[edge.a].T_map_sphere.inverse() @ graph[edge.b].T_map_sphere
        np.testing.assert_allclose(edge.T_a_b.matrix, expected.matrix, atol=1e-9)
    composed = merged.edges[-1]  # 2-3 and 3-1: 1e-4 each, and what the turns of one do to the other
    assert np.linalg.inv(composed.information)[0, 0] == pytest.approx(2e-4)


def left(graph, positions=NOWHERE, **given):
    """Ids of those that are not in the map any more."""
    return graph.nodes.keys() - merge(graph, positions, **given).nodes.keys()


def test_a_sphere_stays_without_a_loop_or_where_its_region_is_needed_or_on_request():
    assert left(line(0.0, 2.0, 4.0, 2.2)) == set()
    graph = line(0.0, 2.0, 4.0, 2.2, loops=[(1, 3)])
    assert left(graph) == {3}
    assert left(graph, staying={3, 1}) == set()
    assert left(line(0.0, 2.0, 4.0, 2.2, regions=[0.3] * 4, loops=[(1, 3)])) == set()
    beside = np.array([[2.3, 0.2, 0.0], [2.3, 2.5, 0.0]])  # taken nearest to 3; the second one by it alone
    assert left(graph, beside[:1]) == {3}
    assert left(graph, beside) == {1}  # so the older one leaves, whose place 3 serves
    assert [(e.a, e.b) for e in merge(line(0.0, 1.0), np.zeros((0, 3))).edges] == [(0, 1)]


def test_a_sphere_of_another_look_is_replaced_by_its_own_experience_alone():
    """4 is where 0 was: the same place, and by its look no other."""
    night = Experience("night")
    graph = line(0.0, 2.0, 4.0, 2.2, 0.3, loops=[(1, 3), (0, 4)]).with_nodes({4: {"experience": night}})
    assert left(graph) == {3, 4}
    assert left(graph, staying=[0], unlike=[4]) == {3}
    both = graph.with_nodes({0: {"experience": night}})
    assert left(both, staying=[0], unlike=[4]) == {3, 4}
