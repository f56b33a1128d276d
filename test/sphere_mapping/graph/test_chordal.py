from dataclasses import replace

import numpy as np
import pytest

from sphere_mapping.graph.chordal import chordal_poses, nearest_rotations
from sphere_nav.geometry import so3
from worlds.cylinder import cylinder


@pytest.mark.parametrize("planar", [False, True])
def test_exact_edges_give_the_truth_whatever_the_start(planar):
    truth, graph = cylinder(3, 8, (1e-9, 1e-9), planar=planar)
    size = graph.dimension + 1
    hopeless = np.tile(np.eye(size), (len(graph.ids), 1, 1))
    found = chordal_poses(replace(graph, poses=hopeless))
    assert np.linalg.norm(found[:, : size - 1, -1] - truth[:, : size - 1, 3], axis=1).max() < 1e-6
    np.testing.assert_allclose(np.linalg.det(found[:, :-1, :-1]), 1.0)


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
    found = chordal_poses(both)
    np.testing.assert_array_equal(both.anchors, [0, 12])
    np.testing.assert_allclose(found[[0, 12]], both.poses[[0, 12]])
    np.testing.assert_allclose(found[12:, :3, 3] - found[:12, :3, 3], 5.0)


def test_the_nearest_rotation_of_a_reflected_one_is_a_rotation():
    R = so3.exp([0.3, -0.2, 0.9])
    np.testing.assert_allclose(nearest_rotations(2.0 * R), R)
    assert np.linalg.det(nearest_rotations(R @ np.diag([1.0, 1.0, -0.5]))) == pytest.approx(1.0)
