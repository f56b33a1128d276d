"""Does light that varies over the view pull the pose?

An alignment knows one gain and one bias for each reference. Where a lamp brightens a part of the view, grey levels that
change slowly from there on look like motion, and in a scene without fine texture the pose follows them: a result that
correlates and has converged, decimetres off. The evidence: let the gain of each reference vary smoothly over the image
and solve once more for all together. The share of the squared residuals that this explains says whether the light is
uneven, the step of the pose how far it has been pulled. Noise explains as much of them as there are numbers for pixels.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import SE3
from sphere_nav.photometric.checks.bias import NO_PULL, Cameras, Look, Pull, linearise, solve, solve_robustly
from sphere_nav.photometric.params import RegistrationParams

Array = NDArray[np.float64]
ORDER = 2  # half periods of the gain across the image, both axes together
ORDERS = [(i, j) for i in range(ORDER + 1) for j in range(ORDER + 1 - i) if i + j]
NUM_COLUMNS = 2 + len(ORDERS)  # of a view: gain, bias, and how the gain varies
NUM_STEPS = 6  # how often pixels are asked anew where light is uneven
DONE = 0.1  # of the pull: a step below it ends the search
UNEVEN_SHARE = 0.2  # of the squared residuals; noise leaves 0.03 at most


def find_pull(look: Look, cameras: Cameras, T_world_body: SE3, params: RegistrationParams) -> Pull:
    """Ask the pixels at an aligned pose and, where light is uneven, on the way to that without it (`look` there).

    The share is that of the squared residuals which uneven light explains.
    """
    problem = linearise(cameras, ORDERS)
    if problem is None:
        return NO_PULL
    J, residual, _ = problem
    x, left, weight = solve_robustly(*problem, params)
    num_views = (J.shape[1] - 6) // NUM_COLUMNS
    even = np.concatenate([np.arange(6), *(6 + NUM_COLUMNS * k + np.arange(2) for k in range(num_views))])
    x_even = solve(J[:, even], residual, weight)
    left_even = residual + J[:, even] @ x_even
    share = 1.0 - float(weight @ left**2) / max(float(weight @ left_even**2), 1e-12)
    found = Pull(share, x[:6] - x_even[:6])
    return replace(found, xi=_go_on(look, T_world_body, found.xi, params)) if share >= UNEVEN_SHARE else found


def _go_on(look: Look, T_world_body: SE3, xi: Array, params: RegistrationParams) -> Array:
    """Return the whole way (6,) that begins with a step."""
    T_pulled = SE3.exp(xi)
    for _ in range(NUM_STEPS):
        problem = linearise(look(T_world_body @ T_pulled), ORDERS)
        if problem is None:
            break
        step = solve_robustly(*problem, params)[0][:6]
        T_pulled = T_pulled @ SE3.exp(step)
        if np.linalg.norm(step) < DONE * np.linalg.norm(T_pulled.log()):
            break
    return np.asarray(T_pulled.log(), np.float64)
