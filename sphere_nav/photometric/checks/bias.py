"""How far something in the view has biased a pose: the pixels of an alignment solved once more, without it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sphere_nav.estimation.normal_equations import weighted_step
from sphere_nav.estimation.robust import weigh
from sphere_nav.geometry.arrays import Array
from sphere_nav.photometric.constants import NUM_REWEIGHTINGS
from sphere_nav.photometric.params import RegistrationParams
from sphere_nav.photometric.pixels.samples import CameraSamples

Orders = Sequence[tuple[int, int]]  # half periods of a gain across the image, along both axes
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


def linearize_samples(cameras: CameraSamples, orders: Orders) -> LeastSquares | None:
    """Return the derivative (N, 6 + views * (2 + orders)) of the residuals (N,), and the view (N,) of each.

    Columns of a view: gain, bias, and how the gain varies over the image.
    """
    views = [(place, sample) for place, samples in cameras for sample in samples]
    if not views:
        return None
    counts, width = [len(sample.residual) for _, sample in views], 2 + len(orders)
    owner = np.repeat(np.arange(len(views)), counts)
    J, first = np.zeros((len(owner), 6 + width * len(views))), 0
    highest = max((max(order) for order in orders), default=0)
    for index, (place, sample) in enumerate(views):
        rows, column = slice(first, first + counts[index]), 6 + width * index
        J[rows, :6] = sample.by_pose if place is None else sample.by_pose @ place.inverse().adjoint()
        half = 0.5 * np.pi * (sample.at + 1.0)
        u, v = ([np.cos(k * axis) for k in range(highest + 1)] for axis in half.T)
        J[rows, column], J[rows, column + 1] = sample.current, 1.0
        for k, (i, j) in enumerate(orders):
            J[rows, column + 2 + k] = sample.current * u[i] * v[j]
        first = rows.stop
    return J, np.concatenate([sample.residual for _, sample in views]), owner


def solve_robustly(
    J: Array, residual: Array, owner: NDArray[np.int64], params: RegistrationParams
) -> tuple[Array, Array, Array]:
    """Return the step, the residuals (N,) after it, and their weights (N,)."""
    remaining = residual
    for _ in range(NUM_REWEIGHTINGS):
        weight = _weights(remaining, owner, params)
        x = weighted_step(J, residual, weight)
        remaining = residual + J @ x
    return x, remaining, weight


def _weights(residual: Array, owner: NDArray[np.int64], params: RegistrationParams) -> Array:
    """Return Huber's weights (N,) by the scatter of each view."""
    weight = np.empty(len(residual))
    for index in np.unique(owner):
        own = owner == index
        weight[own], _ = weigh(residual[own], params.huber, params.min_sigma)
    return weight
