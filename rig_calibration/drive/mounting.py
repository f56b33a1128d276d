"""Where a camera sits on the vehicle, by its poses in a map and the vehicle's odometry.

In each piece of a drive camera and base move as one body: B X = X A, with the motion A of the camera, B of the base and
X = T_base_camera. What is left of it, e = log(X^-1 B^-1 X A), is minimised over all pieces (6 numbers of X, and two by
which the odometry measures ways and turns too short), each weighed by how far it is off. A vehicle on a plane never
shows the height of its camera, one that never turns none of its place: what the drive does not tell stays as it was
given, and is named. Turns that are nothing but noise look like turns that tell: their share of the information counts
as none.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import compress

import numpy as np

from rig_calibration.constants import (
    DIFFERENCE,
    HELD,
    MIN_PIECES,
    MOUNTING_SIGMA,
    MOUNTING_STEPS,
    MOUNTING_UNOBSERVED,
    PIECE_M,
    PIECE_RAD,
    SETTLED,
)
from sphere_nav.estimation.least_squares import CAUCHY, cauchy_weights, clustered_covariance
from sphere_nav.geometry import SE3, so3
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.trajectory_error import MEDIAN_LENGTHS

NAMES = ("x", "y", "z", "roll", "pitch", "yaw", "way_scale", "turn_scale")


@dataclass(frozen=True, eq=False)
class Mounting:
    """T_base_camera in body axes, scales (2,) of the odometry's ways and turns, and how sure all are.

    `deviations` (8,) are those of NAMES: m along and rad about the axes of the base. `rms` is what is left of a piece,
    in m and rad.
    """

    T_base_camera: SE3
    scales: Array
    deviations: Array
    num_pieces: int
    rms: tuple[float, float]

    @property
    def values(self) -> Array:
        """The values (8,) of NAMES; angles as `SE3.from_angles` takes them."""
        return np.array([*self.T_base_camera.translation, *self.T_base_camera.angles, *self.scales])

    @property
    def unobserved(self) -> tuple[str, ...]:
        """What the drive does not tell."""
        return tuple(compress(NAMES, ~(self.deviations < MOUNTING_UNOBSERVED)))


def find_mounting(T_map_camera: SE3, T_odom_base: SE3, given: SE3 | None = None) -> Mounting:
    """Find where a camera (body axes) sits by its poses and those of the base at the same instants, (N,) each.

    `given` is T_base_camera by hand, where there is one; else it begins with what lays ways on ways and turns on turns.
    Raises ValueError for a drive that is too short.
    """
    A, B = _pieces(T_map_camera, T_odom_base)
    if A.matrix.shape[0] < MIN_PIECES:
        needed = f"{MIN_PIECES} pieces of {PIECE_M:g} m or {np.degrees(PIECE_RAD):.0f} deg"
        raise ValueError(f"mounting: expected a drive of at least {needed}, found {A.matrix.shape[0]}")
    if given is None:
        ours, theirs = (T.log().reshape(-1, 3) for T in (A, B))
        given = SE3.from_parts(so3.nearest_rotations(theirs.T @ ours), np.zeros(3))
    return _fit(A, B, given)


def _pieces(T_map_camera: SE3, T_odom_base: SE3) -> tuple[SE3, SE3]:
    """Return the motions of camera and base in pieces that follow each other, so that their errors are their own."""
    ends = [0]
    for index in range(1, T_odom_base.matrix.shape[0]):
        moved, turned = T_odom_base[ends[-1]].distance(T_odom_base[index])
        if moved >= PIECE_M or turned >= PIECE_RAD:
            ends.append(index)
    first, last = np.array(ends[:-1], np.intp), np.array(ends[1:], np.intp)
    return tuple(T[first].inverse() @ T[last] for T in (T_map_camera, T_odom_base))  # type: ignore[return-value]


def hand_eye_residuals(A: SE3, B: SE3, X: SE3, scales: Array) -> Array:
    """Return what is left (N, 6) of B X = X A, (v, omega) in the axes of the camera; X and scales may be batches.

    A piece is taken for a screw, whose way and turn are scaled: exact where it bends evenly.
    """
    scaled = SE3.exp(B.log() * np.repeat(scales, 3, axis=-1))
    return (X.inverse() @ scaled.inverse() @ X @ A).log()


def _moved(X: SE3, scales: Array, step: Array) -> tuple[SE3, Array]:
    """Return X moved along and turned about the axes of the base, and the scales; of steps (..., 8)."""
    turned = so3.exp(step[..., 3:6]) @ X.rotation
    return SE3.from_parts(turned, X.translation + step[..., :3]), scales + step[..., 6:]


def _fit(A: SE3, B: SE3, start: SE3) -> Mounting:
    """Return the mounting nearest a start."""
    X, scales, covariance = _descend(A, B, start, MOUNTING_SIGMA)
    deviations = np.sqrt(np.diagonal(covariance))
    is_told = deviations < MOUNTING_UNOBSERVED
    if not np.all(is_told):
        X, scales, covariance = _descend(A, B, start, np.where(is_told, MOUNTING_SIGMA, HELD))
        deviations = np.where(is_told, np.sqrt(np.diagonal(covariance)), deviations)
    e = hand_eye_residuals(A, B, X, scales)
    rms = float(np.sqrt(3.0 * np.mean(e[:, :3] ** 2))), float(np.sqrt(3.0 * np.mean(e[:, 3:] ** 2)))
    return Mounting(X, scales, deviations, len(e), rms)


def _descend(A: SE3, B: SE3, start: SE3, prior: Array) -> tuple[SE3, Array, Array]:
    """Return X and the scales by Gauss-Newton, and their covariance (8, 8)."""
    X, scales, known = start, np.ones(2), np.diag(prior**-2)
    for _ in range(MOUNTING_STEPS):
        e, J = hand_eye_residuals(A, B, X, scales), _jacobian(A, B, X, scales)
        sigma = _sigma(e)
        weights = _weights(e, sigma)
        weighted = J * weights[:, :, None]
        H, gradients = np.einsum("nij,nik->jk", weighted, J), np.einsum("nij,ni->nj", weighted, e)
        off = np.array([*(X.translation - start.translation), *so3.log(X.rotation @ start.rotation.T), *(scales - 1.0)])
        step = -np.linalg.solve(H + known, gradients.sum(axis=0) + known @ off)
        X, scales = _moved(X, scales, step)
        if np.abs(step / MOUNTING_SIGMA).max() < SETTLED:
            break
    piece = np.arange(len(gradients))  # they are independent
    covariance = clustered_covariance(np.linalg.inv(H + known), gradients, piece, known=known)
    by_noise = np.append(2.0 * sigma[3] ** 2 * np.sum(weights[:, [0, 0, 0, 3, 3, 3]], axis=0), [0.0, 0.0])
    share = np.minimum(by_noise / np.maximum(np.diagonal(H), 1e-300), 1.0)
    return X, scales, covariance + np.diag((share * prior) ** 2)


def _jacobian(A: SE3, B: SE3, X: SE3, scales: Array) -> Array:
    """Return the derivatives (N, 6, 8) of the errors by the steps of `_moved`, by central differences."""
    steps = DIFFERENCE * np.concatenate([np.eye(8), -np.eye(8)])
    ahead, behind = np.split(hand_eye_residuals(A, B, *_moved(X, scales, steps[:, None])), 2)
    return np.moveaxis((ahead - behind) / (2.0 * DIFFERENCE), 0, -1)


def _sigma(e: Array) -> Array:
    """Return robust standard deviations (6,) of the errors: one of the three in m, one of those in rad.

    By lengths: on a plane two turns of three are never off.
    """
    spread = [float(np.median(np.linalg.norm(part, axis=1))) / MEDIAN_LENGTHS[3] for part in (e[:, :3], e[:, 3:])]
    return np.repeat(np.maximum(spread, 1e-9), 3)


def _weights(e: Array, sigma: Array) -> Array:
    """Return weights (N, 6): Cauchy's of a whole piece over the variances, as a wheel that slips spoils all of it."""
    squares = np.mean((e / sigma) ** 2, axis=1)
    return cauchy_weights(squares / CAUCHY**2)[:, None] / sigma**2
