"""Laws of rotations, over batch shapes and ordinary, tiny and almost-pi angles."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sphere_nav.geometry import so3

EXACT = 1e-12  # a few roundings of numbers around one


def test_exp_is_a_rotation_that_agrees_with_scipy_and_log_undoes_it(rotation_vector):
    R = so3.exp(rotation_vector)
    np.testing.assert_allclose(R @ np.swapaxes(R, -1, -2), np.broadcast_to(np.eye(3), R.shape), rtol=0.0, atol=EXACT)
    np.testing.assert_allclose(np.linalg.det(R), 1.0, rtol=0.0, atol=EXACT)
    expected = Rotation.from_rotvec(rotation_vector.reshape(-1, 3)).as_matrix().reshape(R.shape)
    np.testing.assert_allclose(R, expected, rtol=0.0, atol=EXACT)
    # The quaternion's w of an angle pi - d is d / 2, known to 1e-16: the vector is known to about 1e-15.
    np.testing.assert_allclose(so3.log(so3.exp(rotation_vector)), rotation_vector, rtol=0.0, atol=1e-11)


def test_log_of_half_turns_has_norm_pi():
    for axis in (*np.eye(3), [0.6, 0.8, 0.0], [-0.36, 0.48, 0.8]):
        omega = so3.log(so3.exp(np.pi * np.array(axis)))
        assert np.linalg.norm(omega) == pytest.approx(np.pi, abs=1e-12)
        assert abs(omega @ axis) == pytest.approx(np.pi, abs=1e-12)  # either sign of the axis is the same turn


def test_quaternions_go_both_ways_and_agree_with_scipy(rotation_vector):
    R = so3.exp(rotation_vector)
    q = so3.to_quaternion(R)
    np.testing.assert_allclose(np.linalg.norm(q, axis=-1), 1.0, rtol=0.0, atol=EXACT)
    assert np.all(q[..., 3] >= 0)
    np.testing.assert_allclose(so3.from_quaternion(q), R, rtol=0.0, atol=EXACT)
    np.testing.assert_allclose(so3.from_quaternion(-3.5 * q), R, rtol=0.0, atol=EXACT)
    expected = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_quat(canonical=True).reshape(q.shape)
    off = np.minimum(np.abs(q - expected).max(axis=-1), np.abs(q + expected).max(axis=-1))
    assert np.all(off < 1e-9)  # at w = 0 both signs are the same rotation


def test_a_quaternion_without_direction_is_refused():
    for xyzw in [[0, 0, 0, 0], [np.nan, 0, 0, 1], [0, 0, np.inf, 1]]:
        with pytest.raises(ValueError, match="quaternion: expected a non-zero norm"):
            so3.from_quaternion(xyzw)


def test_left_jacobian_is_the_mean_of_the_rotations_on_the_way(rotation_vector):
    nodes, weights = np.polynomial.legendre.leggauss(20)  # exact far beyond rounding for angles up to pi
    mean = sum(w / 2 * so3.exp((x + 1) / 2 * rotation_vector) for x, w in zip(nodes, weights, strict=True))
    np.testing.assert_allclose(so3.exp_and_left_jacobian(rotation_vector)[1], mean, rtol=0.0, atol=1e-11)


def test_the_inverse_of_the_left_jacobian_undoes_it():
    for angle in [0.0, 1e-9, 9e-5, 1.1e-4, 0.3, 2.0, 3.1]:
        omega, vector = angle * np.array([0.36, -0.48, 0.8]), np.array([0.7, -1.1, 2.3])
        found = so3.exp_and_left_jacobian(omega)[1] @ so3.inverse_left_jacobian_times(omega, vector)
        np.testing.assert_allclose(found, vector, rtol=0.0, atol=EXACT)


def test_the_nearest_rotation_is_no_reflection_and_nearer_than_its_neighbours(rng):
    matrices = rng.normal(size=(20, 3, 3))
    R = so3.nearest_rotations(matrices)
    np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.broadcast_to(np.eye(3), R.shape), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(R), 1.0, rtol=0.0, atol=1e-12)
    distance = np.linalg.norm(R - matrices, axis=(1, 2))
    for turn in so3.exp(1e-3 * rng.normal(size=(30, 3))):
        assert np.all(np.linalg.norm(R @ turn - matrices, axis=(1, 2)) > distance)
    np.testing.assert_array_equal(so3.nearest_rotations(matrices[3]), R[3])
