"""What is known of a pose before any image is seen: one more observation in its normal equations."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sphere_nav.estimation.normal_equations import scaled_inverse
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.photometric.align.descent import kernels
from sphere_nav.photometric.constants import EXPECTED_SIGMAS


@dataclass(frozen=True, eq=False)
class Expectation:
    """Where a body is expected.

    information (6, 6) is that of xi in T_world_body @ exp(xi), zero where nothing is known. Beyond `EXPECTED_SIGMAS` it
    pulls no harder (Huber): an expectation that is wrong yields to what is seen.
    """

    T_world_body: SE3
    information: Array

    def weighted(self, factor: float) -> tuple[Array, Array, float]:
        """Return it for the kernels, where so many pixels count as one: T_body_world (3, 4), information, bound."""
        bound = EXPECTED_SIGMAS * float(np.sqrt(factor))
        return self._T_body_world, factor * self.information, bound

    def pull_at(self, T_world_body: SE3) -> tuple[Array, Array]:
        """Return what it adds at a pose to the normal equations: H (6, 6), the information that counts, and g (6,)."""
        H, g = np.zeros((6, 6)), np.zeros(6)
        kernels.add_expectation(np.ascontiguousarray(T_world_body.matrix[:3]), self.weighted(1.0), H, g)
        return H, g

    def resist(self, xi: Array, T_world_body: SE3, covariance: Array) -> Array:
        """Return what is left of a step xi (6,) by images alone from a pose; the expectation is in its covariance."""
        return xi - covariance @ self.pull_at(T_world_body)[0] @ xi

    def fuse(self, T_world_body: SE3, covariance: Array) -> tuple[SE3, Array]:
        """Return a pose by images alone, and its covariance, together with the expectation."""
        H, g = self.pull_at(T_world_body)
        if not H.any():
            return T_world_body, covariance
        together = scaled_inverse(scaled_inverse(covariance) + H)
        return T_world_body @ SE3.exp(-together @ g), together

    @cached_property
    def _T_body_world(self) -> Array:
        return np.ascontiguousarray(self.T_world_body.inverse().matrix[:3])


NO_EXPECTATION = Expectation(SE3.identity(), np.zeros((6, 6)))
