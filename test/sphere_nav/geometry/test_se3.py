"""Laws of rigid motions, over batch shapes and ordinary, tiny and almost-pi rotations."""

import numpy as np
import pytest

from sphere_nav.geometry import SE3

EXACT = 1e-12


def assert_same(a, b, atol=EXACT):
    np.testing.assert_allclose(a.matrix, np.broadcast_to(b.matrix, a.matrix.shape), rtol=0.0, atol=atol)


def test_group_axioms_and_quaternion_and_translation_rebuild_the_motion(motions):
    T_a_b, T_b_c, T_c_d = motions
    assert_same((T_a_b @ T_b_c) @ T_c_d, T_a_b @ (T_b_c @ T_c_d))
    assert_same(T_a_b @ SE3.identity(), T_a_b)
    assert_same(SE3.identity() @ T_a_b, T_a_b)
    assert_same(T_a_b @ T_a_b.inverse(), SE3.identity())
    assert_same((T_a_b @ T_b_c).inverse(), T_b_c.inverse() @ T_a_b.inverse())
    assert_same(SE3.from_quaternion(motions[0].quaternion, motions[0].translation), motions[0])


def test_apply_is_the_group_action(motions):
    T_a_b, T_b_c, _ = motions
    points_c = np.random.default_rng(0).normal(size=(7, 3))
    expected = T_a_b.apply(T_b_c.apply(points_c))
    np.testing.assert_allclose((T_a_b @ T_b_c).apply(points_c), expected, rtol=0.0, atol=EXACT)
    homogeneous = np.concatenate([points_c, np.ones((7, 1))], axis=-1)
    expected = (homogeneous @ np.swapaxes(T_a_b.matrix, -1, -2))[..., :3]
    np.testing.assert_allclose(T_a_b.apply(points_c), expected, rtol=0.0, atol=EXACT)


def test_log_undoes_exp(tangent):
    np.testing.assert_allclose(SE3.exp(tangent).log(), tangent, atol=1e-9)  # V near pi is within 1e3 of singular


def test_adjoint_moves_a_tangent_to_the_other_side(motions, tangent):
    T_a_b = motions[0]
    moved = (T_a_b.adjoint() @ tangent[..., None])[..., 0]
    assert_same(SE3.exp(moved) @ T_a_b, T_a_b @ SE3.exp(tangent), atol=1e-11)


def test_planar_pose_has_its_yaw():
    T_map_base = SE3.from_planar(3.0, -1.0, 2.5)
    assert T_map_base.yaw == pytest.approx(2.5, abs=EXACT)
    expected = [[3 + np.cos(2.5), -1 + np.sin(2.5), 0]]
    np.testing.assert_allclose(T_map_base.apply([[1.0, 0, 0]]), expected, rtol=0.0, atol=EXACT)


def test_distance_is_that_of_the_motion_between(motions):
    step = SE3.exp([0.3, 0.4, 0.0, 0.0, 0.0, 0.25])
    meters, radians = motions[0].distance(motions[0] @ step)
    np.testing.assert_allclose(meters, np.linalg.norm(step.translation), rtol=0.0, atol=EXACT)
    np.testing.assert_allclose(radians, 0.25, rtol=0.0, atol=EXACT)


def test_from_matrix_mends_rounding_and_refuses_what_is_no_rigid_motion(motions):
    rounded = np.round(motions[0].matrix, 5)
    mended = SE3.from_matrix(rounded)
    R = mended.rotation
    np.testing.assert_allclose(R @ np.swapaxes(R, -1, -2), np.broadcast_to(np.eye(3), R.shape), rtol=0.0, atol=EXACT)
    assert_same(mended, motions[0], atol=2e-5)
    mirror, perspective = np.diag([1.0, 1.0, -1.0, 1.0]), np.eye(4) + np.eye(4, k=-1) * 0.1
    for matrix in [np.eye(3), np.full((4, 4), np.nan), 1.1 * np.eye(4), mirror, perspective, np.zeros((4, 4))]:
        with pytest.raises(ValueError, match="rigid motion: expected"):
            SE3.from_matrix(matrix)


def test_a_bent_rotation_is_made_orthogonal_by_the_square_of_what_it_is_bent(motions):
    for motion in motions:
        T = SE3(motion.matrix + np.pad(np.full((3, 3), 1e-6), (0, 1))).orthonormal()
        np.testing.assert_allclose(T.rotation @ np.swapaxes(T.rotation, -1, -2) - np.eye(3), 0.0, atol=1e-10)
        assert_same(T, motion, atol=1e-5)
