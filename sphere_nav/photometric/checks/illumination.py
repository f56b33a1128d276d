"""Does an illumination gradient over the view bias the pose?

An alignment knows one gain and one bias for each reference. Where a lamp brightens a part of the view, grey levels that
change slowly from there on look like motion, and in a scene without fine texture the pose follows them: a result that
correlates and has converged, decimetres off. The evidence: let the gain of each reference vary smoothly over the image
and solve once more for all together. The share of the squared residuals that this explains says whether there is
a gradient, the step of the pose how far it is biased. Noise explains as much of them as there are numbers for pixels.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sphere_nav.estimation.normal_equations import weighted_step
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.photometric.checks.bias import (
    NO_BIAS,
    PoseBias,
    linearize_samples,
    solve_robustly,
)
from sphere_nav.photometric.constants import BIAS_STEPS, GRADIENT_ORDER, GRADIENT_SHARE, LAST_GRADIENT_STEP
from sphere_nav.photometric.params import RegistrationParams
from sphere_nav.photometric.pixels.samples import CameraSamples, Sampler

ORDERS = [(i, j) for i in range(GRADIENT_ORDER + 1) for j in range(GRADIENT_ORDER + 1 - i) if i + j]
NUM_COLUMNS = 2 + len(ORDERS)  # of a view: gain, bias, and how the gain varies


def find_illumination_bias(
    sampler: Sampler, cameras: CameraSamples, T_world_body: SE3, params: RegistrationParams
) -> PoseBias:
    """Return the bias at an aligned pose; where there is a gradient, sample pixels anew on the way to the one without.

    The share is that of the squared residuals which the gradient explains.
    """
    problem = linearize_samples(cameras, ORDERS)
    if problem is None:
        return NO_BIAS
    J, residual, _ = problem
    x, remaining, weight = solve_robustly(*problem, params)
    num_views = (J.shape[1] - 6) // NUM_COLUMNS
    even = np.concatenate([np.arange(6), *(6 + NUM_COLUMNS * k + np.arange(2) for k in range(num_views))])
    x_even = weighted_step(J[:, even], residual, weight)
    remaining_even = residual + J[:, even] @ x_even
    share = 1.0 - float(weight @ remaining**2) / max(float(weight @ remaining_even**2), 1e-12)
    found = PoseBias(share, x[:6] - x_even[:6])
    return replace(found, xi=_descend(sampler, T_world_body, found.xi, params)) if share >= GRADIENT_SHARE else found


def _descend(sampler: Sampler, T_world_body: SE3, xi: Array, params: RegistrationParams) -> Array:
    """Return the whole bias (6,) whose first step is known."""
    T_bias = SE3.exp(xi)
    for _ in range(BIAS_STEPS):
        problem = linearize_samples(sampler(T_world_body @ T_bias), ORDERS)
        if problem is None:
            break
        step = solve_robustly(*problem, params)[0][:6]
        T_bias = T_bias @ SE3.exp(step)
        if np.linalg.norm(step) < LAST_GRADIENT_STEP * np.linalg.norm(T_bias.log()):
            break
    return np.asarray(T_bias.log(), np.float64)
