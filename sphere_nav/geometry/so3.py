"""Rotations: exponential, logarithm, Jacobian and quaternions, batched over leading axes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sphere_nav.geometry.arrays import TINY, Array

SMALL_ANGLE = 1e-4  # below it the series of sin(a)/a and its kin are exact to 1e-17
LEAST_COSINE = -0.9  # of a turn whose sine tells its axis well enough


def hat(vector: ArrayLike) -> Array:
    """Return the cross-product matrix [v]x of (..., 3) as (..., 3, 3)."""
    v = np.asarray(vector, dtype=np.float64)
    K = np.zeros((*v.shape, 3))
    K[..., 2, 1] = v[..., 0]
    K[..., 0, 2] = v[..., 1]
    K[..., 1, 0] = v[..., 2]
    return K - np.swapaxes(K, -1, -2)


def exp(rotation_vector: ArrayLike) -> Array:
    """Return the rotation (..., 3, 3) by a rotation vector (..., 3) in radians (Rodrigues)."""
    rotation, _ = exp_and_left_jacobian(rotation_vector)
    return rotation


def exp_and_left_jacobian(rotation_vector: ArrayLike) -> tuple[Array, Array]:
    """Return `exp` and V (..., 3, 3), the integral of exp(s omega) for s from 0 to 1; SE(3) translations are V v."""
    omega = np.asarray(rotation_vector, dtype=np.float64)
    if omega.ndim == 1:
        return _exp_of_one(*omega.tolist())
    a, b, c = _series(np.sqrt(np.einsum("...i,...i->...", omega, omega)))
    K = hat(omega)
    KK = K @ K
    a, b, c = a[..., None, None], b[..., None, None], c[..., None, None]
    identity = np.eye(3)
    return identity + a * K + b * KK, identity + b * K + c * KK


def log(rotation: ArrayLike) -> Array:
    """Return the rotation vector (..., 3) of (..., 3, 3), of norm at most pi, also near pi."""
    R = np.asarray(rotation, dtype=np.float64)
    if R.ndim == 2:
        (a, b, c), (d, e, f), (g, h, i) = R.tolist()
        x, y, z, cosine = 0.5 * (h - f), 0.5 * (c - g), 0.5 * (d - b), 0.5 * (a + e + i - 1.0)
        sine = math.sqrt(x * x + y * y + z * z)
        if cosine > LEAST_COSINE:
            factor = math.atan2(sine, cosine) / sine if sine > TINY else 1.0
            return np.array([factor * x, factor * y, factor * z])
    vector: Array = _by_scipy(R).as_rotvec().reshape(R.shape[:-1])
    return vector


def to_quaternion(rotation: ArrayLike) -> Array:
    """Return the unit quaternion (x, y, z, w), w >= 0, of a rotation (..., 3, 3)."""
    R = np.asarray(rotation, dtype=np.float64)
    unit: Array = _by_scipy(R).as_quat(canonical=True).reshape(*R.shape[:-2], 4)
    return unit


def _by_scipy(R: Array) -> Any:
    from scipy.spatial.transform import Rotation  # what only reads bags does without it

    return Rotation.from_matrix(R.reshape(-1, 3, 3))


def from_quaternion(xyzw: ArrayLike) -> Array:
    """Return the rotation (..., 3, 3) of a quaternion (x, y, z, w) of any non-zero norm."""
    q = np.asarray(xyzw, dtype=np.float64)
    norm = np.linalg.norm(q, axis=-1, keepdims=True)
    if not np.all(np.isfinite(norm)) or np.any(norm < 1e-9):
        raise ValueError(f"quaternion: expected a non-zero norm, found {q.tolist()}")
    vector, w = (q / norm)[..., :3], (q / norm)[..., 3]
    K = hat(vector)
    R: Array = np.eye(3) + 2.0 * (w[..., None, None] * K + K @ K)
    return R


def nearest_rotations(matrices: Array) -> Array:
    """Return the rotations (..., d, d) nearest to matrices (..., d, d) by the sum of squares, d 2 or 3 (Kabsch).

    U diag(1, ..., det(U V')) V' of the singular value decomposition.
    """
    U, _, Vt = np.linalg.svd(matrices)
    U[..., :, -1] *= np.linalg.det(U @ Vt)[..., None]
    rotations: Array = U @ Vt
    return rotations


def inverse_left_jacobian_times(rotation_vector: Array, vector: Array) -> Array:
    """Return V^-1 v (3,) of one rotation vector (3,) and one vector (3,)."""
    rotation, translation = rotation_vector.tolist(), vector.tolist()
    x, y, z = rotation
    square = x * x + y * y + z * z
    if square < SMALL_ANGLE**2:
        k = 1.0 / 12.0 + square / 720.0
    else:
        angle = math.sqrt(square)
        k = (1.0 - 0.5 * angle * math.cos(0.5 * angle) / math.sin(0.5 * angle)) / square
    once = _cross(rotation, translation)
    twice = _cross(rotation, once)
    return np.array([p - 0.5 * a + k * b for p, a, b in zip(translation, once, twice, strict=True)])


# One motion at a time is what tracking needs hundreds of times an image: arithmetic on floats is ten times faster than
# NumPy is on arrays this small.


def _cross(a: list[float], b: list[float]) -> list[float]:
    (x, y, z), (p, q, r) = a, b
    return [y * r - z * q, z * p - x * r, x * q - y * p]


def _exp_of_one(x: float, y: float, z: float) -> tuple[Array, Array]:
    square = x * x + y * y + z * z
    if square < SMALL_ANGLE**2:
        a, b, c = 1.0 - square / 6.0, 0.5 - square / 24.0, 1.0 / 6.0 - square / 120.0
    else:
        angle = math.sqrt(square)
        half = math.sin(0.5 * angle) / angle
        sine = math.sin(angle)
        a, b, c = sine / angle, 2.0 * half * half, (angle - sine) / (square * angle)
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    first, second = (
        np.array(
            [
                [1.0 - n * (yy + zz), n * xy - m * z, n * xz + m * y],
                [n * xy + m * z, 1.0 - n * (xx + zz), n * yz - m * x],
                [n * xz - m * y, n * yz + m * x, 1.0 - n * (xx + yy)],
            ]
        )
        for m, n in ((a, b), (b, c))
    )
    return first, second


def _series(angle: Array) -> tuple[Array, Array, Array]:
    """Return sin(a)/a, (1 - cos a)/a^2 and (a - sin a)/a^3, all of the shape of the angle."""
    small = angle < SMALL_ANGLE
    safe = np.where(small, 1.0, angle)
    square = angle * angle
    sine, half = np.sin(safe), np.sin(safe / 2.0) / safe
    return (
        np.where(small, 1.0 - square / 6.0, sine / safe),
        np.where(small, 0.5 - square / 24.0, 2.0 * half * half),
        np.where(small, 1.0 / 6.0 - square / 120.0, (safe - sine) / (safe * safe * safe)),
    )
