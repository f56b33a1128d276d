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


@dataclass(frozen=True)
class NormalEquations:
    """H x = -g over (v, omega, gain, bias), (v, omega) those of xi in T_world_camera exp(xi).

    H and g are in units of the residual's variance, `sigma` squared: a view that explains the image badly counts less.
    `residual` (N,) is in grey levels, NaN where not visible, and valid until the view is compared again.
    """

    H: Array
    g: Array
    residual: NDArray[np.float32]
    median: float
    mad: float
    num_visible: int
    num_inliers: int
    sigma: float


class ViewSolver:
    """Buffers and constants of one view at one level, so that an iteration allocates nothing that is large."""

    def __init__(self, pixels: ReferenceLevel, level: Level) -> None:
        self.pixels = pixels
        self.level = level
        number = pixels.num_pixels
        self._inputs = (pixels.points, pixels.intensity, pixels.gradient)
        self._image = (*kernel_camera(level.camera), level.image, level.pad)
        self._residual = np.empty(number, np.float32)
        self._buffers = (
            scratch(),
            self._residual,
            np.empty((3, number), np.float32),
            np.empty((kernels.NUM_CHUNKS, kernels.NUM_BINS), np.int32),
            np.empty((kernels.NUM_CHUNKS, kernels.NUM_SUMS)),
        )

    def compare(self, T_camera_reference: SE3, gain: float, bias: float, params: RegistrationParams) -> NormalEquations:
        """Warp the reference into the image, subtract, differentiate, weigh and sum (M15 eq. 4, 6, 30-35)."""
        H, g = np.empty((8, 8)), np.empty(8)
        T = T_camera_reference.matrix[:3]
        robust = (params.huber, params.min_sigma)
        found = kernels.normal_equations(*self._inputs, T, *self._image, gain, bias, *robust, *self._buffers, H, g)
        sigma = max(SIGMA_OF_MAD * found[1], params.min_sigma)
        median, mad, num_visible, num_inliers = found
        return NormalEquations(H / sigma**2, g / sigma**2, self._residual, median, mad, num_visible, num_inliers, sigma)

    def piece_sums(self) -> Array:
        """Return the sums (pieces, NUM_SUMS) of the pieces of the last comparison."""
        sums = self._buffers[-1][: kernels.num_pieces(self.pixels.num_pixels)].copy()
        sums[0] -= sums[1:].sum(axis=0)  # the first row holds the total
        return sums
