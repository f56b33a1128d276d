"""One view's residuals and its robust normal equations, in the tangent of the camera pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photometric import kernels
from photometric.params import RegistrationParams
from photometric.pyramid import Level
from photometric.reference import ReferenceLevel, kernel_camera
from photometric.robust import SIGMA_OF_MAD
from photometric.scratch import scratch
from sphere_geometry import SE3

Array = NDArray[np.float64]
UPPER = np.triu_indices(9)


@dataclass(frozen=True)
class Linearisation:
    """Residuals (N,) of one view, NaN where not visible, with their gradient by the reference point (3, N)."""

    residual: NDArray[np.float32]
    gradient: NDArray[np.float32]
    median: float
    mad: float
    num_visible: int


@dataclass(frozen=True)
class NormalEquations:
    """H x = -g over (v, omega, gain, bias); `weight` sums the robust weights."""

    H: Array
    g: Array
    cost: float
    weight: float
    num_inliers: int


class ViewSolver:
    """Buffers and constants of one view at one level, so that an iteration allocates nothing that is large."""

    def __init__(self, pixels: ReferenceLevel, level: Level) -> None:
        self.pixels = pixels
        self.level = level
        self.model, self.coefficients = kernel_camera(level.camera)
        number = pixels.num_pixels
        self._residual = np.empty(number, np.float32)
        self._gradient = np.empty((3, number), np.float32)
        self._histogram = np.empty((kernels.NUM_CHUNKS, kernels.NUM_BINS), np.int32)
        self._sums = np.empty((kernels.NUM_CHUNKS, kernels.NUM_SUMS))

    def linearise(self, T_camera_reference: SE3, gain: float, bias: float) -> Linearisation:
        """Warp the reference into the camera and compare (M15 eq. 4); valid until the next call."""
        pixels, level = self.pixels, self.level
        T = np.ascontiguousarray(T_camera_reference.matrix[:3], dtype=np.float32)
        kernels.linearise(
            pixels.points, pixels.intensity, pixels.gradient, T, self.model, self.coefficients, level.image, level.pad,
            np.float32(gain), np.float32(bias), scratch(), self._residual, self._gradient, self._histogram,
        )  # fmt: skip
        median, mad, number = kernels.median_and_mad(self._histogram)
        return Linearisation(self._residual, self._gradient, median, mad, number)

    def normal_equations(
        self, found: Linearisation, gain: float, bias: float, params: RegistrationParams
    ) -> NormalEquations:
        """Weigh and sum (M15 eq. 6, 33-35), in the tangent of the reference frame."""
        pixels = self.pixels
        sigma = max(SIGMA_OF_MAD * found.mad, params.min_sigma)
        kernels.accumulate(
            pixels.points, pixels.intensity, found.residual, found.gradient, np.float32(found.median),
            np.float32(params.huber * sigma), np.float32(gain), np.float32(bias), scratch(), self._sums,
        )  # fmt: skip
        total = self._sums.sum(axis=0)
        full = np.zeros((9, 9))
        full[UPPER] = total[:45]
        full += np.triu(full, 1).T
        return NormalEquations(full[:8, :8], full[:8, 8], full[8, 8], total[45], int(total[46]))


def in_camera_tangent(equations: NormalEquations, T_camera_reference: SE3) -> tuple[Array, Array]:
    """Return H, g over the local increment of the camera pose, T_world_camera exp(xi) (M15 eq. 31-32).

    The kernels differentiate by x in T_camera_reference exp(x); x = -Ad(T_reference_camera) xi.
    """
    A = np.eye(8)
    A[:6, :6] = -T_camera_reference.inverse().adjoint()
    return A.T @ equations.H @ A, A.T @ equations.g
