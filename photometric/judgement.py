"""Whether the end of a registration is a result: overlap, texture, outliers, convergence, covariance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from photometric import alignment
from photometric.alignment import Alignment
from photometric.correlation import correlated_pixels
from photometric.normal_equations import NormalEquations
from photometric.params import RegistrationParams
from photometric.problem import Problem, State

Array = NDArray[np.float64]
UNKNOWN = np.diag(np.full(6, np.inf))
STUCK = 25.0  # still moving this many times `min_step` at the end is no convergence


def judge(
    problem: Problem, state: State, iterations: int, motion: float, overlap: float, params: RegistrationParams
) -> Alignment:
    """Compare once more at the end and say what was found; `motion` is the last increment in pixels."""
    found = problem.compare(state)
    num_pixels = sum(view.num_visible for view in found)
    if num_pixels < params.min_pixels or overlap < params.min_overlap:
        return _refused(state, alignment.LOW_OVERLAP, iterations, num_pixels, overlap)
    mad = float(np.average([view.mad for view in found], weights=[view.num_visible for view in found]))
    H, _ = problem.joint(found)
    covariance, condition = _covariance(H)
    correlation = correlated_pixels(problem.solvers, found, params.correlated_pixels)
    reason = alignment.GOOD
    if condition > params.max_condition:
        reason = alignment.LOW_TEXTURE
    elif motion > STUCK * params.min_step:
        reason = alignment.NO_CONVERGENCE
    elif mad > params.max_mad:
        reason = alignment.OUTLIERS
    return Alignment(
        T_world_camera=state.T_world_camera,
        covariance=covariance * correlation if reason != alignment.LOW_TEXTURE else UNKNOWN,
        reason=reason,
        iterations=iterations,
        num_pixels=num_pixels,
        overlap=overlap,
        inlier_share=sum(view.num_inliers for view in found) / num_pixels,
        mad=mad,
        ncc=_correlation(problem, found),
        gains=state.gains,
        biases=state.biases,
    )


def _refused(state: State, reason: str, iterations: int, num_pixels: int, overlap: float) -> Alignment:
    return Alignment(
        state.T_world_camera, UNKNOWN, reason, iterations, num_pixels, overlap, 0.0, 0.0, 0.0, state.gains, state.biases
    )


def _covariance(H: Array) -> tuple[Array, float]:
    """Return the covariance of the pose, were all pixels independent, and the condition of the scaled normal matrix.

    Light is eliminated: what it could explain is not known of the pose.
    """
    pose, cross, light = H[:6, :6], H[:6, 6:], H[6:, 6:]
    marginal = pose - cross @ np.linalg.solve(light, cross.T) if light.size else pose
    if not np.all(np.isfinite(marginal)):
        return UNKNOWN, np.inf
    scale = np.sqrt(np.maximum(np.diagonal(marginal), 1e-300))
    eigenvalues, vectors = np.linalg.eigh(marginal / np.outer(scale, scale))
    if eigenvalues[0] <= 0:
        return UNKNOWN, np.inf
    inverse = (vectors / eigenvalues) @ vectors.T / np.outer(scale, scale)
    return inverse, float(eigenvalues[-1] / eigenvalues[0])


def _correlation(problem: Problem, found: list[NormalEquations]) -> float:
    """Return the normalised cross correlation of reference and warped image over all visible pixels (M15 5.4).

    Views count as they do in the alignment, by the inverse of their residual's deviation.
    """
    reference, current = [], []
    for solver, view in zip(problem.solvers, found, strict=True):
        seen = ~np.isnan(view.residual)
        if not seen.any():
            continue
        intensity = solver.pixels.intensity[seen]
        reference.append((intensity - intensity.mean()) / view.sigma)
        warped = view.residual[seen] + intensity
        current.append((warped - warped.mean()) / view.sigma)
    a, b = np.concatenate(reference), np.concatenate(current)
    norm = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / norm if norm > 0 else 0.0
