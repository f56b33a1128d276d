"""Does light that varies over the view pull the pose?

An alignment knows one gain and one bias for each reference. Where a lamp brightens a part of the view, grey levels that
change slowly from there on look like motion, and in a scene without fine texture the pose follows them: a result that
correlates and has converged, decimetres off. The evidence: let the gain of each reference vary smoothly over the image
and solve once more for all together. The share of the squared residuals that this explains says whether the light is
uneven, the step of the pose how far it has been pulled. Noise explains as much of them as there are numbers for pixels.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from photometric.params import RegistrationParams
from photometric.robust import weigh
from photometric.samples import Sample
from sphere_geometry import SE3

Array = NDArray[np.float64]
ORDER = 2  # half periods of the gain across the image, both axes together
ORDERS = [(i, j) for i in range(ORDER + 1) for j in range(ORDER + 1 - i) if i + j]
NUM_COLUMNS = 2 + len(ORDERS)  # of a view: gain, bias, and how the gain varies
NUM_WEIGHTS, NUM_STEPS = 2, 6  # how often weights are found anew, and how often pixels, where light is uneven
DONE = 0.1  # of the pull: a step below it ends the search
UNEVEN_SHARE = 0.2  # of the squared residuals; noise leaves 0.03 at most
RIDGE = 1e-9


@dataclass(frozen=True, eq=False)
class Pull:
    """share 0...1 of the squared residuals that uneven light explains; xi (6,) from the pose to where that would be."""

    share: float = 0.0
    xi: Array = field(default_factory=lambda: np.zeros(6))

    @property
    def is_uneven(self) -> bool:
        """Whether the light varies."""
        return self.share >= UNEVEN_SHARE


NO_PULL = Pull()
Problem = tuple[Array, Array, NDArray[np.int64]]
Cameras = Sequence[tuple[SE3 | None, Sequence[Sample]]]  # T_body_camera (None: it is the body), pixels of its views


def find_pull(look: Callable[[SE3], Cameras], cameras: Cameras, T_world_body: SE3, params: RegistrationParams) -> Pull:
    """Ask the pixels at an aligned pose and, where light is uneven, on the way to that without it (`look` there)."""
    problem = _linearise(cameras)
    if problem is None:
        return NO_PULL
    J, residual, _ = problem
    x, left, weight = _solve_robustly(*problem, params)
    num_views = (J.shape[1] - 6) // NUM_COLUMNS
    even = np.concatenate([np.arange(6), *(6 + NUM_COLUMNS * k + np.arange(2) for k in range(num_views))])
    x_even = _solve(J[:, even], residual, weight)
    left_even = residual + J[:, even] @ x_even
    share = 1.0 - float(weight @ left**2) / max(float(weight @ left_even**2), 1e-12)
    found = Pull(share, x[:6] - x_even[:6])
    return replace(found, xi=_go_on(look, T_world_body, found.xi, params)) if found.is_uneven else found


def _go_on(look: Callable[[SE3], Cameras], T_world_body: SE3, xi: Array, params: RegistrationParams) -> Array:
    """Return the whole way (6,) that begins with a step."""
    T_pulled = SE3.exp(xi)
    for _ in range(NUM_STEPS):
        problem = _linearise(look(T_world_body @ T_pulled))
        if problem is None:
            break
        step = _solve_robustly(*problem, params)[0][:6]
        T_pulled = T_pulled @ SE3.exp(step)
        if np.linalg.norm(step) < DONE * np.linalg.norm(T_pulled.log()):
            break
    return np.asarray(T_pulled.log(), np.float64)


def _linearise(cameras: Cameras) -> Problem | None:
    """Return the derivative (N, 6 + views * NUM_COLUMNS) of the residuals (N,), and the view (N,) of each."""
    views = [(place, sample) for place, samples in cameras for sample in samples]
    if not views:
        return None
    counts = [len(sample.residual) for _, sample in views]
    owner = np.repeat(np.arange(len(views)), counts)
    J, first = np.zeros((len(owner), 6 + NUM_COLUMNS * len(views))), 0
    for index, (place, sample) in enumerate(views):
        rows, column = slice(first, first + counts[index]), 6 + NUM_COLUMNS * index
        J[rows, :6] = sample.by_pose if place is None else sample.by_pose @ place.inverse().adjoint()
        half = 0.5 * np.pi * (sample.at + 1.0)
        u, v = ([np.cos(k * axis) for k in range(ORDER + 1)] for axis in half.T)
        J[rows, column], J[rows, column + 1] = sample.current, 1.0
        for k, (i, j) in enumerate(ORDERS):
            J[rows, column + 2 + k] = sample.current * u[i] * v[j]
        first = rows.stop
    return J, np.concatenate([sample.residual for _, sample in views]), owner


def _solve_robustly(
    J: Array, residual: Array, owner: NDArray[np.int64], params: RegistrationParams
) -> tuple[Array, Array, Array]:
    """Return the step, what it leaves of the residuals (N,), and their weights (N,)."""
    left = residual
    for _ in range(NUM_WEIGHTS):
        weight = _weights(left, owner, params)
        x = _solve(J, residual, weight)
        left = residual + J @ x
    return x, left, weight


def _weights(residual: Array, owner: NDArray[np.int64], params: RegistrationParams) -> Array:
    """Return Huber's weights (N,) by the scatter of each view."""
    weight = np.empty(len(residual))
    for index in range(int(owner[-1]) + 1):
        own = owner == index
        weight[own], _ = weigh(residual[own], params.huber, params.min_sigma)
    return weight


def _solve(J: Array, residual: Array, weight: Array) -> Array:
    """Return the step that leaves least."""
    weighted = weight[:, None] * J
    H, g = weighted.T @ J, weighted.T @ residual
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(H), 1e-300))
    step = np.linalg.solve(H * np.outer(scale, scale) + RIDGE * np.eye(len(g)), -scale * g)
    return np.asarray(scale * step, np.float64)
