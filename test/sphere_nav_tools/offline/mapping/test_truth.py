"""A map is moved to the true poses of its bag."""

import numpy as np

from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.spheres.graph import KeySphere, SphereGraph
from sphere_nav_tools.offline.mapping.drive import fit_poses, move_to_truth, truth_of
from worlds.recordings import stereo, truth_of_base, write_bag


def test_the_truth_of_the_vehicle_is_known_as_such_and_none_as_none(tmp_path):
    write_bag(tmp_path / "base", truth_of_base, numbers=range(2))
    write_bag(tmp_path / "none", stereo, numbers=range(1))
    assert truth_of(tmp_path / "base").is_base
    assert truth_of(tmp_path / "none") is None


def test_poses_are_brought_together_by_all_of_them(rng):
    ours = SE3.exp(rng.normal(size=(30, 6)))
    T = SE3.exp([3.0, -1.0, 0.5, 0.2, -0.4, 2.0])
    theirs = T @ ours
    np.testing.assert_allclose(fit_poses(theirs, ours).matrix, T.matrix, atol=1e-12)
    noise = np.concatenate([0.01 * rng.normal(size=(30, 3)), 0.01 * rng.normal(size=(30, 3))], axis=1)
    off = [float(value) for value in fit_poses(theirs @ SE3.exp(noise), ours).distance(T)]
    assert 0 < max(off) < 0.02


def test_key_spheres_move_to_their_true_poses_where_these_are_known():
    stamps = np.array([0, 1, 2, 4]) * 10**9
    truth = Trajectory(stamps, SE3(np.stack([SE3.from_planar(float(x), 1.0, 0.5).matrix for x in (0, 1, 2, 4)])))
    nodes = [KeySphere(k, int(s * 1e9), SE3.from_planar(9.0, 9.0, 0.0)) for k, s in enumerate((0.5, 2.0, 3.0, 7.0))]
    T_base_sphere = SE3.exp([0.2, 0.0, 1.0, 0.0, 0.0, 0.1])
    for is_base in (False, True):
        T_pose_sphere = T_base_sphere if is_base else SE3.identity()
        found = move_to_truth(SphereGraph(nodes), truth, T_pose_sphere)
        expected = SE3.from_planar(0.5, 1.0, 0.5) @ T_pose_sphere
        np.testing.assert_allclose(found[0].T_map_sphere.matrix, expected.matrix, atol=1e-9)
        assert found[1].T_map_sphere.translation[0] != 9.0
        for lost in (2, 3):  # between rows two seconds apart, and behind the last
            assert found[lost].T_map_sphere.translation[0] == 9.0
