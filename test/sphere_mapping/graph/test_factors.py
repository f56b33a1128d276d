import pytest

from sphere_mapping.graph.factors import chi2_of, factors_of
from sphere_nav.geometry import SE3
from worlds.cylinder import cylinder


def test_chi2_is_the_weighted_sum_of_logarithms():
    _, graph = cylinder(2, 6, (0.2, 0.1))
    total = 0.0
    for (a, b), motion, information in zip(graph.ends, graph.motions, graph.information, strict=True):
        xi = (SE3(motion).inverse() @ SE3(graph.poses[a]).inverse() @ SE3(graph.poses[b])).log()
        total += xi @ information @ xi
    assert chi2_of(factors_of(graph), graph, graph.poses) == pytest.approx(total)
