from dataclasses import replace

import numpy as np
import pytest

from sphere_mapping.graph.factors import chi2_of, factors_of, minimize_poses, values_of
from sphere_nav.geometry import SE3
from worlds.cylinder import cylinder


def test_chi2_is_the_weighted_sum_of_logarithms():
    _, graph = cylinder(2, 6, (0.2, 0.1))
    total = 0.0
    for (a, b), motion, information in zip(graph.ends, graph.motions, graph.information, strict=True):
        xi = (SE3(motion).inverse() @ SE3(graph.poses[a]).inverse() @ SE3(graph.poses[b])).log()
        total += xi @ information @ xi
    assert chi2_of(factors_of(graph), values_of(graph)) == pytest.approx(total)


def test_a_start_that_needs_no_guess_leads_to_the_truth_where_edges_are_nearly_exact():
    truth, graph = cylinder(3, 8, (1e-3, 1e-3))
    hopeless = replace(graph, poses=np.tile(np.eye(4), (len(graph.ids), 1, 1)))
    factors = factors_of(hopeless)
    found = minimize_poses(factors, hopeless)
    assert np.linalg.norm(found.poses[:, :3, 3] - truth[:, :3, 3], axis=1).max() < 0.01


def test_every_connected_part_keeps_its_first_pose():
    _, graph = cylinder(2, 6, (0.01, 0.01))
    away = graph.poses.copy()
    away[:, :3, 3] += 5.0
    both = replace(
        graph,
        ids=np.arange(24),
        poses=np.concatenate([graph.poses, away]),
        ends=np.concatenate([graph.ends, graph.ends + 12]),
        motions=np.concatenate([graph.motions] * 2),
        information=np.concatenate([graph.information] * 2),
        is_robust=np.zeros(2 * len(graph.ends), bool),
    )
    factors = factors_of(both)
    found = minimize_poses(factors, both).poses
    np.testing.assert_array_equal(both.anchors, [0, 12])
    np.testing.assert_allclose(found[[0, 12]], both.poses[[0, 12]], atol=1e-6)
    np.testing.assert_allclose(found[12:, :3, 3] - found[:12, :3, 3], 5.0, atol=1e-6)
