import numpy as np
import pytest

from sphere_mapping.graph.factors import chi2_of, factors_of, minimize_poses
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
