from dataclasses import replace

import numpy as np
import pytest

from sphere_mapping.graph.certificate import certify
from sphere_mapping.graph.chordal import as_rows, chordal_poses, quadratic_form
from sphere_mapping.graph.factors import factors_of, minimize_poses
from worlds.cylinder import cylinder


def cost(graph, poses):
    X = as_rows(poses)
    return float(np.trace(X @ quadratic_form(graph) @ X.T))


@pytest.mark.parametrize("planar", [False, True])
def test_the_optimum_is_stationary_and_certified(planar):
    _, graph = cylinder(4, 10, (0.1, 0.05), planar=planar)
    found = certify(graph, chordal_poses(graph))
    assert found.is_global
    assert found.cost == pytest.approx(cost(graph, found.poses))
    rng = np.random.default_rng(1)
    for _ in range(20):  # no small motion of the poses lowers the cost
        moved = found.poses.copy()
        d, free = graph.dimension, np.arange(1, len(graph.ids))
        moved[free, :d, d] += 1e-4 * rng.normal(size=(len(free), d))
        turn = 1e-4 * rng.normal(size=(len(free), d, d))
        turns = np.linalg.qr(np.eye(d) + turn - np.swapaxes(turn, 1, 2))[0]
        turns *= np.sign(np.diagonal(turns, axis1=1, axis2=2))[:, None, :]
        moved[free, :d, :d] = moved[free, :d, :d] @ turns
        assert cost(graph, moved) > found.cost


def test_a_local_optimum_gets_no_certificate():
    """Steps of a ring bent once around too often: every step fits a little worse, and no small change helps."""
    truth, graph = cylinder(1, 12, (0.1, 0.1), planar=True)
    back = np.linalg.inv(graph.poses[0]) @ graph.poses[11]
    ring = replace(
        graph,
        ends=np.concatenate([graph.ends, [[0, 11]]]),
        motions=np.concatenate([graph.motions, [np.linalg.inv(graph.motions[0])]]),
        information=np.concatenate([graph.information, graph.information[:1]]),
        is_robust=np.zeros(len(graph.ends) + 1, bool),
    )
    assert back.shape == (3, 3)
    turns = 2.0 * 2.0 * np.pi * np.arange(12) / 12  # twice around in place of once
    wound = truth[:, [0, 1, 3]][:, :, [0, 1, 3]].copy()
    wound[:, 0, 0] = wound[:, 1, 1] = np.cos(turns)
    wound[:, 1, 0] = np.sin(turns)
    wound[:, 0, 1] = -wound[:, 1, 0]
    local, best = certify(ring, wound), certify(ring, chordal_poses(ring))
    assert best.is_global
    assert local.cost > 2.0 * best.cost
    assert not local.is_global


def test_a_tolerance_of_nothing_is_never_reached():
    _, graph = cylinder(3, 8, (0.1, 0.05))
    assert not certify(graph, chordal_poses(graph), tolerance=-1e-6).is_global


def test_where_gtsam_ends_with_isotropic_information_and_small_noise_is_the_same_place():
    _, graph = cylinder(4, 10, (0.01, 0.005))
    ours, theirs = certify(graph, chordal_poses(graph)), minimize_poses(factors_of(graph), graph, graph.poses, 50)
    assert theirs is not None
    assert ours.cost == pytest.approx(theirs.chi2, rel=1e-3)
    assert np.abs(ours.poses - theirs.poses).max() < 1e-3
