"""How far something in the view has biased a pose: the pixels of an alignment solved once more, without it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sphere_nav.estimation.normal_equations import weighted_step
from sphere_nav.estimation.robust import weigh
from sphere_nav.geometry.arrays import Array
from sphere_nav.photometric.constants import MIN_SIGMA, NUM_REWEIGHTINGS
from sphere_nav.photometric.pixels.samples import Sample

LeastSquares = tuple[Array, Array, NDArray[np.int64]]


@dataclass(frozen=True, eq=False)
class PoseBias:
    """share 0...1 of the evidence that the cause explains; xi (6,) from the pose to the one without it."""

    share: float = 0.0
    xi: Array = field(default_factory=lambda: np.zeros(6))

    @property
    def lengths(self) -> tuple[float, float]:
        """Size of the bias in m and in rad."""
        return float(np.linalg.norm(self.xi[:3])), float(np.linalg.norm(self.xi[3:]))


NO_BIAS = PoseBias()


def linearize_samples(sample: Sample) -> LeastSquares:
    """Return the derivative (N, 6 + 2 * views) of the residuals (N,), and the view (N,) of each.

    Columns of a view: gain, bias.
    """
    names, owner = np.unique(sample.view, return_inverse=True)
    J, rows, gain = np.zeros((len(owner), 6 + 2 * len(names))), np.arange(len(owner)), 6 + 2 * owner
    J[:, :6], J[rows, gain], J[rows, gain + 1] = sample.by_pose, sample.current, 1.0
    return J, sample.residual, owner


def solve_robustly(J: Array, residual: Array, owner: NDArray[np.int64]) -> tuple[Array, Array, Array]:
    """Return the step, the residuals (N,) after it, and their weights (N,)."""
    remaining = residual
    for _ in range(NUM_REWEIGHTINGS):
        weight = _weights(remaining, owner)
        x = weighted_step(J, residual, weight)
        remaining = residual + J @ x
    return x, remaining, weight


def _weights(residual: Array, owner: NDArray[np.int64]) -> Array:
    """Return Huber's weights (N,) by the scatter of each view."""
    weight = np.empty(len(residual))
    for index in np.unique(owner):
        own = owner == index
        weight[own], _ = weigh(residual[own], MIN_SIGMA)
    return weight
