import numpy as np
import pytest

from sphere_mapping.graph.factors import chi2_of, factors_of, innovations, minimize_poses
from sphere_mapping.graph.outliers import graph_of_edges, loops_of
from sphere_nav.geometry import SE3
from worlds.cylinder import cylinder


def test_chi2_is_the_weighted_sum_of_logarithms():
    _, graph = cylinder(2, 6, (0.2, 0.1))
    total = 0.0
    for (a, b), motion, information in zip(graph.ends, graph.motions, graph.information, strict=True):
        xi = (SE3(motion).inverse() @ SE3(graph.poses[a]).inverse() @ SE3(graph.poses[b])).log()
        total += xi @ information @ xi
    assert chi2_of(factors_of(graph), graph, graph.poses) == pytest.approx(total)


@pytest.mark.parametrize("planar", [False, True])
def test_a_descent_keeps_the_first_pose_and_lowers_chi2(planar):
    _, graph = cylinder(3, 8, (0.1, 0.05), planar=planar)
    factors = factors_of(graph)
    found = minimize_poses(factors, graph, graph.poses, 50)
    assert found is not None
    assert found.chi2 < chi2_of(factors, graph, graph.poses)
    np.testing.assert_allclose(found.poses[0], graph.poses[0], atol=1e-5)


@pytest.mark.parametrize("planar", [False, True])
def test_an_innovation_is_what_an_edge_adds_to_chi2(planar):
    _, graph = cylinder(3, 8, (0.02, 0.01), planar=planar, seed=1)
    rows = np.flatnonzero(loops_of(graph))[:3]
    for row in rows:
        is_kept = np.arange(len(graph.ends)) != row
        without = graph_of_edges(graph, is_kept)
        before = minimize_poses(factors_of(without), without, graph.poses)
        after = minimize_poses(factors_of(graph), graph, graph.poses)
        added = innovations(without, graph_of_edges(graph, ~is_kept), before.poses)
        assert added[0] == pytest.approx(after.chi2 - before.chi2, rel=0.02)
        bound = innovations(without, graph_of_edges(graph, ~is_kept), before.poses, 0.0)  # nothing is below the limit
        assert 0.1 * added[0] < bound[0] <= added[0]
