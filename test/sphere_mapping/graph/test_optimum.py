import numpy as np
import pytest
from scipy.stats import chi2

from sphere_mapping.graph.optimum import factors_of, fits, optimize_map, values_of
from sphere_nav.geometry import SE3
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph

STEP = SE3.exp([1.0, 0.0, 0.05, 0.0, 0.05, 0.5])


def ring(noise):
    """A drive in a circle: true poses, and a graph whose poses are the chained, noisy edges."""
    rng = np.random.default_rng(0)
    truth = [SE3.identity()]
    for _ in range(11):
        truth.append(truth[-1] @ STEP)
    graph = SphereGraph([KeySphere(0, 0, truth[0])])
    for k in range(11):
        T_a_b = truth[k].inverse() @ truth[k + 1] @ SE3.exp(noise * rng.normal(size=6))
        graph.add(KeySphere(k + 1, k + 1, graph[k].T_map_sphere @ T_a_b))
        graph.connect(Edge(k, k + 1, T_a_b, np.eye(6) / max(noise, 1e-3) ** 2))
    return truth, graph


def test_a_loop_takes_most_of_the_drift_away_and_the_first_pose_stays():
    truth, graph = ring(noise=0.02)
    before = graph[11].T_map_sphere.distance(truth[11])[0]
    graph.connect(Edge(0, 11, truth[0].inverse() @ truth[11], np.eye(6) * 1e6, is_loop=True))
    found = optimize_map(graph)
    assert found[11].T_map_sphere.distance(truth[11])[0] < 0.3 * before
    np.testing.assert_allclose(found[0].T_map_sphere.matrix, np.eye(4), atol=1e-5)


def test_a_wrong_loop_among_good_ones_is_outvoted():
    truth, graph = ring(noise=0.01)
    for a in range(4):
        graph.connect(Edge(a, a + 8, truth[a].inverse() @ truth[a + 8], np.eye(6) * 1e4, is_loop=True))
    graph.connect(Edge(1, 10, SE3.exp([3.0, 0, 0, 0, 0, 1.0]), np.eye(6) * 1e4, is_loop=True))
    found = optimize_map(graph)
    worst = max(found[k].T_map_sphere.distance(truth[k])[0] for k in range(12))
    assert worst < 0.15  # with a square cost the wrong edge of 3 m bends the graph by half a metre


def test_what_fits_is_told_by_how_much_noise_leaves():
    left = 4.0 * np.random.default_rng(6).chisquare(6, 2000)
    found = np.mean([fits(value, 1) for value in left])
    expected = chi2.cdf(chi2.ppf(0.999, 6) / 4.0, 6)
    assert abs(found - expected) < 3 * np.sqrt(expected * (1 - expected) / 2000)
    assert fits(0.0, 0)
    assert not fits(1e-6, 0)


def test_the_order_of_the_tangent_is_kept():
    # certain about translation along x only: a disagreement in x is settled by that edge, in y by the other
    graph = SphereGraph([KeySphere(0, 0, SE3.identity()), KeySphere(1, 1, SE3.identity())])
    graph.connect(Edge(0, 1, SE3.exp([1.0, 1.0, 0, 0, 0, 0]), np.diag([1e6, 1, 1e3, 1e3, 1e3, 1e3])))
    graph.connect(Edge(0, 1, SE3.exp([2.0, 2.0, 0, 0, 0, 0]), np.diag([1, 1e6, 1e3, 1e3, 1e3, 1e3])))
    np.testing.assert_allclose(optimize_map(graph)[1].T_map_sphere.translation, [1.0, 2.0, 0.0], atol=1e-4)


def test_chi2_is_the_weighted_sum_of_logarithms():
    _, graph = ring(noise=0.02)
    graph.connect(Edge(0, 11, STEP, np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])))
    row = {node.id: node.id for node in graph}
    total = 0.0
    for edge in graph.edges:
        T_a_b = graph[edge.a].T_map_sphere.inverse() @ graph[edge.b].T_map_sphere
        xi = (edge.T_a_b.inverse() @ T_a_b).log()
        total += xi @ edge.information @ xi
    assert 2.0 * factors_of(graph.edges, row).error(values_of(graph, row)) == pytest.approx(total)


def test_no_guess_is_needed_and_every_connected_part_keeps_its_first_pose():
    truth, graph = ring(noise=0.001)
    away = SE3.exp([9.0, 0.0, 0.0, 0.0, 0.0, 0.5])
    nodes = [KeySphere(k, k, SE3.identity()) for k in range(12)]
    nodes += [KeySphere(k + 12, k, away) for k in range(12)]
    edges = list(graph.edges)
    both = SphereGraph(nodes, edges + [Edge(e.a + 12, e.b + 12, e.T_a_b, e.information) for e in edges])
    found = optimize_map(both)
    for k in range(12):
        assert found[k].T_map_sphere.distance(truth[k])[0] < 0.02
        assert found[k + 12].T_map_sphere.distance(away @ truth[k])[0] < 0.02
    np.testing.assert_allclose(found[12].T_map_sphere.matrix, away.matrix, atol=1e-5)
