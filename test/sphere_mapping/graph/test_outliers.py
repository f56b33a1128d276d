from dataclasses import replace

import numpy as np
import pytest

from sphere_mapping.graph import outliers
from sphere_mapping.graph.factors import edge_chi2
from sphere_mapping.graph.optimum import optimize
from sphere_mapping.graph.outliers import cycle_support, graph_of_edges, loops_of, optimize_robustly
from sphere_nav.geometry import SE3
from worlds.cylinder import cylinder


def with_false(graph, count, seed=0):
    """Add loops between poses by chance, with the motion between two others."""
    rng, T = np.random.default_rng(seed), graph.poses
    i, j, a, b = rng.integers(len(T), size=(4, 10 * count))
    motions = np.linalg.inv(T[i]) @ T[j]
    is_wrong = np.linalg.norm(motions - np.linalg.inv(T[a]) @ T[b], axis=(1, 2)) > 1.5  # by chance some are true
    a, b, motions = (values[is_wrong & (np.abs(a - b) > 1)][:count] for values in (a, b, motions))
    is_false = np.arange(len(graph.ends) + count) >= len(graph.ends)
    spoiled = replace(
        graph,
        ends=np.vstack([graph.ends, np.column_stack([a, b])]),
        motions=np.concatenate([graph.motions, motions]),
        information=np.concatenate([graph.information, graph.information[:count]]),
        is_robust=np.zeros(len(is_false), bool),
    )
    return spoiled, is_false


@pytest.mark.parametrize(("planar", "scale"), [(False, 1.0), (True, 1e-4)])  # files get the scale of information wrong
def test_the_optimum_of_the_true_loops_is_found_among_false_ones(planar, scale):
    _, graph = cylinder(6, 12, (0.05, 0.02), planar=planar, seed=2)
    graph = replace(graph, information=scale * graph.information)
    clean = optimize(graph).chi2_after
    spoiled, is_false = with_false(graph, 24)
    found = optimize_robustly(spoiled)
    np.testing.assert_array_equal(found.is_outlier, is_false)
    assert edge_chi2(graph, found.optimum.poses).sum() == pytest.approx(clean, rel=0.01)
    assert found.chi2[is_false].sum() > 10 * clean
    if not planar:
        plain = optimize(graph_of_edges(spoiled, ~is_false | (np.cumsum(is_false) <= 3)))
        assert edge_chi2(graph, plain.poses).sum() > 1.2 * clean  # three false ones are enough without


def test_information_that_is_a_thousand_times_surer_along_one_axis_loses_no_true_loop():
    _, graph = cylinder(6, 12, (0.05, 0.02), planar=True, seed=2)
    is_loop = loops_of(graph)
    information = graph.information.copy()
    information[is_loop, 0, 0] *= 1000.0
    graph = replace(graph, information=information)
    spoiled, is_false = with_false(graph, 24)
    np.testing.assert_array_equal(optimize_robustly(spoiled).is_outlier, is_false)


def test_nothing_is_left_out_of_true_loops():
    _, graph = cylinder(6, 12, (0.1, 0.05), seed=3)
    found = optimize_robustly(graph)
    assert not found.is_outlier.any()
    assert found.optimum.chi2_after == pytest.approx(optimize(graph).chi2_after, rel=1e-6)


def test_a_single_loop_that_odometry_can_reach_is_kept_and_one_that_it_cannot_is_not():
    _, graph = cylinder(2, 12, (0.05, 0.02), seed=1)
    alone = graph_of_edges(graph, ~loops_of(graph))
    truth = optimize(graph).poses
    right = np.linalg.inv(truth[2]) @ truth[20]
    for motion, is_outlier in ((right, False), (right @ SE3.exp([9.0, 0, 0, 0, 0, 1.0]).matrix, True)):
        one = replace(
            alone,
            ends=np.vstack([alone.ends, [(2, 20)]]),
            motions=np.concatenate([alone.motions, motion[None]]),
            information=np.concatenate([alone.information, alone.information[:1]]),
            is_robust=np.zeros(len(alone.ends) + 1, bool),
        )
        assert optimize_robustly(one).is_outlier[-1] == is_outlier


@pytest.mark.slow
def test_a_loop_without_support_is_not_bent_to_where_nearly_all_others_have_it():
    _, graph = cylinder(28, 12, (0.05, 0.02), planar=True, seed=1)
    last = len(graph.ids) - 12  # behind it there is odometry alone, which would bend
    graph = graph_of_edges(graph, ~loops_of(graph) | (graph.ends.max(axis=1) < last))
    truth = optimize(graph).poses
    off = np.array([[1.0, 0.0, 0.6], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    one = replace(
        graph,
        ends=np.vstack([graph.ends, [(5, len(truth) - 1)]]),
        motions=np.concatenate([graph.motions, (np.linalg.inv(truth[5]) @ truth[-1] @ off)[None]]),
        information=np.concatenate([graph.information, graph.information[:1]]),
        is_robust=np.zeros(len(graph.ends) + 1, bool),
    )
    assert np.flatnonzero(optimize_robustly(one).is_outlier).tolist() == [len(graph.ends)]
    alone = graph_of_edges(one, ~loops_of(one) | (np.arange(len(one.ends)) == len(graph.ends)))
    assert not optimize_robustly(alone).is_outlier.any()


def test_the_kept_edges_are_settled_from_their_own_start_where_the_poses_are_in_a_valley_and_from_the_poses_else():
    _, graph = cylinder(6, 12, (0.05, 0.02), planar=True, seed=2)
    best, first, every = optimize(graph), len(graph.ids) // 2, np.ones(len(graph.ends), bool)
    poses, turned = best.poses.copy(), np.diag([-1.0, -1.0, 1.0])
    poses[first:] = poses[first] @ turned @ np.linalg.inv(poses[first]) @ poses[first:]
    assert edge_chi2(graph, outliers._solve(graph, every, None, poses)).sum() > 100 * best.chi2_after
    assert edge_chi2(graph, outliers._settle(graph, every, poses)).sum() == pytest.approx(best.chi2_after, rel=1e-6)
    spoiled, is_false = with_false(graph, 24)  # so many spoil the start that needs no poses
    every = np.ones(len(is_false), bool)
    near = edge_chi2(spoiled, outliers._solve(spoiled, every, None, best.poses)).sum()
    assert edge_chi2(spoiled, outliers._settle(spoiled, every, best.poses)).sum() == pytest.approx(near, rel=1e-6)


def test_loops_support_each_other_along_short_odometry_only_and_in_any_direction():
    _, graph = cylinder(4, 12, (0.01, 0.005), seed=4)
    is_loop = loops_of(graph)
    spoiled, _ = with_false(graph, 5, seed=3)
    support = cycle_support(spoiled, loops_of(spoiled))
    assert np.max(support[:-5][is_loop]) < 0.1 * np.min(support[-5:])
    assert np.all(np.isinf(support[~loops_of(spoiled)]))
    back = replace(spoiled, ends=spoiled.ends[:, ::-1], motions=np.linalg.inv(spoiled.motions))
    np.testing.assert_allclose(cycle_support(back, loops_of(back))[loops_of(back)], support[loops_of(back)], rtol=0.5)
    broken = graph_of_edges(graph, is_loop)  # no odometry at all
    assert np.all(np.isinf(cycle_support(broken, loops_of(broken))))


def test_a_graph_of_odometry_alone_is_its_own_optimum():
    _, graph = cylinder(2, 6, (0.1, 0.05))
    alone = graph_of_edges(graph, ~loops_of(graph))
    found = optimize_robustly(alone)
    assert not found.is_outlier.any()
    assert found.optimum.chi2_after < 1e-6
