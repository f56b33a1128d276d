"""Rigid motions as immutable values. `T_a_b` maps coordinates in b to coordinates in a (docs/conventions.md)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sphere_nav.geometry import so3
from sphere_nav.geometry.arrays import Array, Flags


@dataclass(frozen=True, eq=False)
class SE3:
    """A rigid motion, or a batch of them; `matrix` is (..., 4, 4). Tangent vectors are (v, omega)."""

    matrix: Array

    @staticmethod
    def identity() -> SE3:
        """Return the motion that moves nothing."""
        return SE3(np.eye(4))

    @staticmethod
    def from_matrix(matrix: ArrayLike, tolerance: float = 1e-3) -> SE3:
        """Check a (..., 4, 4) matrix from outside, make its rotation exactly orthogonal; ValueError if it is none."""
        found = np.asarray(matrix, dtype=np.float64)
        if found.shape[-2:] != (4, 4) or not np.all(np.isfinite(found)):
            raise ValueError(f"rigid motion: expected finite (..., 4, 4), found shape {found.shape}")
        R = so3.nearest_rotations(found[..., :3, :3])
        error = np.abs(R - found[..., :3, :3]).max()
        if error > tolerance or np.any(found[..., 3, :] != (0, 0, 0, 1)):
            raise ValueError(f"rigid motion: expected a rotation, found one off by {error:.3g}")
        return SE3.from_parts(R, found[..., :3, 3])

    @staticmethod
    def from_parts(rotation: ArrayLike, translation: ArrayLike) -> SE3:
        """Join a rotation (..., 3, 3) and a translation (..., 3) in metres."""
        t = np.asarray(translation, dtype=np.float64)
        R = np.asarray(rotation, dtype=np.float64)
        is_single = t.ndim == 1 and R.ndim == 2  # the usual case, without the time that broadcasting takes
        matrix = np.zeros((4, 4) if is_single else (*np.broadcast_shapes(t.shape[:-1], R.shape[:-2]), 4, 4))
        matrix[..., :3, :3], matrix[..., :3, 3], matrix[..., 3, 3] = R, t, 1.0
        return SE3(matrix)

    @staticmethod
    def from_quaternion(xyzw: ArrayLike, translation: ArrayLike) -> SE3:
        """Join a quaternion (x, y, z, w) and a translation in metres, as messages carry them."""
        return SE3.from_parts(so3.from_quaternion(xyzw), translation)

    @staticmethod
    def from_angles(roll: float, pitch: float, yaw: float, translation: ArrayLike) -> SE3:
        """Return the pose turned about the fixed axes x, then y, then z (rad), as static_transform_publisher has it."""
        x, y, z = so3.exp([roll, 0.0, 0.0]), so3.exp([0.0, pitch, 0.0]), so3.exp([0.0, 0.0, yaw])
        return SE3.from_parts(z @ y @ x, translation)

    @staticmethod
    def from_planar(x: float, y: float, yaw: float) -> SE3:
        """Return the pose of a vehicle on flat ground, yaw in radians about +z."""
        return SE3.from_parts(so3.exp([0.0, 0.0, yaw]), [x, y, 0.0])

    @staticmethod
    def exp(tangent: ArrayLike) -> SE3:
        """Return the motion of a tangent vector (..., 6) = (v, omega) (M15 eq. 1)."""
        xi = np.asarray(tangent, dtype=np.float64)
        v, omega = xi[..., :3], xi[..., 3:]
        R, V = so3.exp_and_left_jacobian(omega)
        return SE3.from_parts(R, (V @ v[..., None])[..., 0])

    def log(self) -> Array:
        """Return the tangent vector (..., 6) = (v, omega), the inverse of `exp`."""
        omega = so3.log(self.rotation)
        if omega.ndim == 1:
            return np.concatenate([so3.inverse_left_jacobian_times(omega, self.translation), omega])
        v = np.linalg.solve(so3.exp_and_left_jacobian(omega)[1], self.translation[..., None])[..., 0]
        return np.concatenate([v, omega], axis=-1)

    @property
    def rotation(self) -> Array:
        """Rotation matrix (..., 3, 3)."""
        return self.matrix[..., :3, :3]

    @property
    def translation(self) -> Array:
        """Translation (..., 3) in metres."""
        return self.matrix[..., :3, 3]

    @property
    def quaternion(self) -> Array:
        """Unit quaternion (..., 4) as (x, y, z, w), w >= 0."""
        return so3.to_quaternion(self.rotation)

    @property
    def angles(self) -> Array:
        """Roll, pitch and yaw (..., 3) in rad, as `from_angles` takes them."""
        R = self.rotation
        pitch = np.arcsin(np.clip(-R[..., 2, 0], -1.0, 1.0))
        return np.stack(
            [np.arctan2(R[..., 2, 1], R[..., 2, 2]), pitch, np.arctan2(R[..., 1, 0], R[..., 0, 0])], axis=-1
        )

    @property
    def yaw(self) -> Array:
        """Heading about +z in radians, of the x axis."""
        return np.arctan2(self.matrix[..., 1, 0], self.matrix[..., 0, 0])

    def __matmul__(self, other: SE3) -> SE3:
        """Compose: `T_a_b @ T_b_c` is `T_a_c`."""
        return SE3(self.matrix @ other.matrix)

    def __getitem__(self, index: int | slice | NDArray[np.integer] | Flags) -> SE3:
        """Pick from a batch."""
        return SE3(self.matrix[index])

    def inverse(self) -> SE3:
        """Return the motion back: `T_a_b.inverse()` is `T_b_a`."""
        Rt = np.swapaxes(self.rotation, -1, -2)
        return SE3.from_parts(Rt, -(Rt @ self.matrix[..., :3, 3:])[..., 0])

    def orthonormal(self) -> SE3:
        """Return the motion with its rotation made orthogonal, where only rounding has bent it (a step of Newton's).

        In chains of products with inverses, which take the transpose for the inverse, rounding errors double each time.
        """
        R = self.rotation
        return SE3.from_parts(0.5 * R @ (3.0 * np.eye(3) - np.swapaxes(R, -1, -2) @ R), self.translation)

    def apply(self, points: ArrayLike) -> Array:
        """Map points (..., N, 3) in b to points in a."""
        return np.asarray(points) @ np.swapaxes(self.rotation, -1, -2) + self.translation[..., None, :]

    def adjoint(self) -> Array:
        """Return Ad (..., 6, 6) with exp(Ad xi) @ T = T @ exp(xi) (M15 eq. 32)."""
        R = self.rotation
        Ad = np.zeros((*R.shape[:-2], 6, 6))
        Ad[..., :3, :3] = Ad[..., 3:, 3:] = R
        Ad[..., :3, 3:] = so3.hat(self.translation) @ R
        return Ad

    def distance(self, other: SE3) -> tuple[Array, Array]:
        """Return how far apart two poses are: metres between origins, radians between axes."""
        between = self.inverse() @ other
        angle = np.linalg.norm(so3.log(between.rotation), axis=-1)
        return np.linalg.norm(between.translation, axis=-1), angle
