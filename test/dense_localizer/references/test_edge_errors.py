"""How sure a key sphere is among those around it: by hand-made graphs whose covariances are known in closed form."""

import numpy as np
import pytest

from dense_localizer.references.edge_errors import EdgeErrors, is_usable, relative_covariances
from sphere_nav.geometry import SE3
from sphere_nav.spheres.graph import Edge, Experience, KeySphere, SphereGraph

HERE = SE3.identity()
LOOSE, TIGHT = 1e-2, 1e-6
EDGE_HOPS = 5


def graph_of(edges, poses=None, experiences=None):
    ids = sorted({end for edge in edges for end in (edge.a, edge.b)})
    poses, experiences = poses or {}, experiences or {}
    nodes = [KeySphere(i, i, poses.get(i, HERE), experience=experiences.get(i, Experience())) for i in ids]
    return SphereGraph(nodes, edges)


def edge(a, b, variance, T=HERE, is_loop=False):
    return Edge(a, b, T, np.eye(6) / variance, is_loop)


def sigma2(edges, sphere_id, **more):
    found = EdgeErrors(graph_of(edges, **more)).covariance(sphere_id)
    return None if found is None else float(found[0, 0])


def test_in_a_chain_errors_add_up_to_all_that_few_edges_reach():
    edges = [edge(0, 1, 1e-4), edge(1, 2, 3e-4), edge(2, 3, 5e-4)]
    assert sigma2(edges, 0) == pytest.approx((1 + 4 + 9) / 3 * 1e-4)
    assert sigma2(edges, 1) == pytest.approx((1 + 3 + 8) / 3 * 1e-4)
    assert sigma2(edges, 2) == pytest.approx((4 + 3 + 5) / 3 * 1e-4)
    far = [edge(k, k + 1, 1e-4) for k in range(EDGE_HOPS + 3)]
    assert sigma2(far, 0) == pytest.approx((EDGE_HOPS + 1) / 2 * 1e-4)


def test_a_wide_edge_is_as_sure_as_the_way_around_it():
    around = [edge(0, 2, TIGHT), edge(2, 3, TIGHT), edge(3, 1, TIGHT)]
    expected = 1 / (1 / LOOSE + 1 / (3 * TIGHT))
    motions = relative_covariances(*graph_and_edges([edge(0, 1, LOOSE), *around]), 0)
    np.testing.assert_allclose(np.diagonal(motions[1]), expected, rtol=1e-6)
    assert sigma2([edge(0, 1, LOOSE)], 0) == pytest.approx(LOOSE)


def test_a_refuted_loop_makes_nothing_sure():
    wrong = edge(0, 1, TIGHT, SE3.from_planar(0.01, 0.0, 0.0), is_loop=True)  # ten standard deviations off
    right = edge(0, 1, TIGHT, SE3.from_planar(0.004, 0.0, 0.0), is_loop=True)
    assert not is_usable(graph_of([wrong]), wrong)
    assert is_usable(graph_of([right]), right)
    assert is_usable(graph_of([wrong]), edge(0, 1, TIGHT, SE3.from_planar(0.01, 0.0, 0.0)))  # of the drive itself
    assert sigma2([edge(0, 1, LOOSE), wrong], 0) == pytest.approx(LOOSE)
    assert sigma2([edge(0, 1, LOOSE), right], 0) == pytest.approx(TIGHT, rel=1e-3)


@pytest.mark.parametrize(
    "lost",
    [edge(1, 2, TIGHT, SE3.from_planar(1.0, 0.0, 0.0), is_loop=True), Edge(1, 2, HERE, np.diag([1.0, 1, 1, 1, 1, 0]))],
    ids=["refuted", "singular"],
)
def test_a_key_sphere_that_nothing_holds_makes_the_others_no_surer(lost):
    assert sigma2([edge(0, 1, LOOSE), lost], 0) == pytest.approx(LOOSE)


def test_around_a_loop_information_is_that_of_numerical_derivatives():
    rng = np.random.default_rng(5)
    poses = {k: SE3.exp(rng.normal(size=6) * 0.8) for k in range(4)}
    edges = []
    for a, b in ((0, 1), (1, 2), (2, 3), (1, 3)):
        root = rng.normal(size=(6, 6))
        edges.append(Edge(a, b, poses[a].inverse() @ poses[b], root @ root.T + np.eye(6), is_loop=b - a > 1))

    def residuals(x):
        at = {0: poses[0]} | {k: poses[k] @ SE3.exp(x[6 * k - 6 : 6 * k]) for k in (1, 2, 3)}
        return [(one.T_a_b.inverse() @ at[one.a].inverse() @ at[one.b]).log() for one in edges]

    step, information = 1e-6, np.zeros((18, 18))
    J = np.array([np.subtract(residuals(step * e), residuals(-step * e)) / (2 * step) for e in np.eye(18)])
    for k, one in enumerate(edges):
        information += J[:, k] @ one.information @ J[:, k].T
    motions = relative_covariances(*graph_and_edges(edges, poses), 0)
    covariance = np.linalg.inv(information)
    for k in (1, 2, 3):
        at = slice(6 * k - 6, 6 * k)
        np.testing.assert_allclose(motions[k], covariance[at, at], rtol=1e-6, atol=1e-9)


def test_an_error_of_a_turned_key_sphere_lies_along_its_axes():
    turned = SE3.from_planar(0.0, 0.0, np.pi / 2)
    variance = np.array([1e-4, 4e-6, 1e-6, 1e-6, 1e-6, 4e-6])
    one = EdgeErrors(graph_of([Edge(0, 1, turned, np.diag(1 / variance))], {1: turned}))
    np.testing.assert_allclose(np.diagonal(one.covariance(0)), variance[[1, 0, 2, 4, 3, 5]], rtol=1e-9)


def graph_and_edges(edges, poses=None):
    edges_of = {}
    for one in edges:
        edges_of.setdefault(one.a, []).append(one)
        edges_of.setdefault(one.b, []).append(one)
    return graph_of(edges, poses), edges_of
