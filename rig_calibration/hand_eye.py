"""Two unknown poses from many instants, X M_i = A_i Z: a camera and a board that only ever see each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from sphere_geometry import SE3, so3

Array = NDArray[np.float64]

NUM_STARTS = 60
NUM_REFINED = 6
NUM_ALTERNATIONS = 10


def hand_eye(M: SE3, A: SE3, rng: np.random.Generator) -> tuple[SE3, SE3, float]:
    """Return X and Z of X M_i = A_i Z and the RMS of what remains, in metres and radians alike.

    `M` and `A` are batches (N,), N >= 3. Rotations are found by alternation from many starts, then all twelve numbers
    together. What the motion does not show (a translation along the only axis of rotation) stays near zero.
    """
    starts = [_alternate(M, A, so3.exp(turn)) for turn in _turns(rng)]
    starts.sort(key=lambda pair: pair[1])
    scale = float(np.median(np.linalg.norm(M.translation, axis=-1))) + 1e-9
    found = [_refine(M, A, R_X, scale) for R_X, _ in starts[:: max(NUM_STARTS // NUM_REFINED, 1)]]
    found += [_refine(M, A, R_X, scale) for R_X, _ in starts[:NUM_REFINED]]
    return min(found, key=lambda triple: triple[2])


def _turns(rng: np.random.Generator) -> Array:
    """Return rotation vectors (NUM_STARTS, 3) spread over all rotations."""
    xyzw = rng.normal(size=(NUM_STARTS, 4))
    return so3.log(so3.from_quaternion(xyzw))


def _alternate(M: SE3, A: SE3, R_X: Array) -> tuple[Array, float]:
    R_M, R_A = M.rotation, A.rotation
    R_Z = np.eye(3)
    for _ in range(NUM_ALTERNATIONS):
        R_Z = _nearest(np.sum(np.swapaxes(R_A, 1, 2) @ R_X @ R_M, axis=0))
        R_X = _nearest(np.sum(R_A @ R_Z @ np.swapaxes(R_M, 1, 2), axis=0))
    return R_X, float(np.linalg.norm(R_X @ R_M - R_A @ R_Z))


def _refine(M: SE3, A: SE3, R_X: Array, scale: float) -> tuple[SE3, SE3, float]:
    R_Z = _nearest(np.sum(np.swapaxes(A.rotation, 1, 2) @ R_X @ M.rotation, axis=0))
    left = np.concatenate([np.broadcast_to(np.eye(3), M.rotation.shape), -A.rotation], axis=-1).reshape(-1, 6)
    right = (A.translation - np.einsum("ij,nj->ni", R_X, M.translation)).ravel()
    t = np.linalg.lstsq(left, right, rcond=1e-6)[0]
    X, Z = SE3.from_parts(R_X, t[:3]), SE3.from_parts(R_Z, t[3:])

    def errors(step: Array) -> Array:
        difference = (A @ Z @ SE3.exp(step[6:])).inverse() @ (X @ SE3.exp(step[:6]) @ M)
        turn = so3.log(difference.rotation)
        return np.concatenate([difference.translation / scale, turn], axis=-1).ravel()

    best = least_squares(errors, np.zeros(12), loss="soft_l1", f_scale=0.02, max_nfev=40)
    rms = float(np.sqrt(2.0 * best.cost / M.matrix.shape[0]))
    return X @ SE3.exp(best.x[:6]), Z @ SE3.exp(best.x[6:]), rms


def _nearest(matrix: Array) -> Array:
    U, _, Vt = np.linalg.svd(matrix)
    rotation: Array = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return rotation
