"""What a registration found, and whether it may be used: overlap, texture, outliers, convergence, covariance.

How many pixels count as one independent observation, measured by how differently parts of the image bias the pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sphere_nav.estimation.normal_equations import inverse_and_condition, scaled_inverse
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.photometric.align.descent import kernels
from sphere_nav.photometric.align.iteration.kernels import NUM_COLUMNS
from sphere_nav.photometric.align.problem import AlignmentState, Descent, ViewComparison
from sphere_nav.photometric.constants import STUCK
from sphere_nav.photometric.params import RegistrationParams

GOOD, LOW_OVERLAP, LOW_TEXTURE = "", "LOW_OVERLAP", "LOW_TEXTURE"
NO_CONVERGENCE, OUTLIERS = "NO_CONVERGENCE", "OUTLIERS"
UNKNOWN = np.diag(np.full(6, np.inf))  # covariance of a pose that nothing is known of


@dataclass(frozen=True)
class Alignment:
    """Result of `register`. When `reason` is not empty the pose is the last one tried, not to be used.

    covariance (6, 6) is that of xi in T_world_camera @ exp(xi), (v, omega); infinite on the diagonal where nothing
    is known. overlap is the share of the current image that the references cover, mad in grey levels, ncc the
    normalised cross correlation of the warped image, gains and biases map current grey levels to each reference's.
    """

    T_world_camera: SE3
    covariance: Array
    reason: str
    iterations: int
    num_pixels: int
    overlap: float
    inlier_share: float
    mad: float
    ncc: float
    gains: tuple[float, ...]
    biases: tuple[float, ...]

    @property
    def light(self) -> Array:
        """Gain and bias (views, 2) of each reference."""
        return np.column_stack([self.gains, self.biases])

    @property
    def is_converged(self) -> bool:
        """Whether the result may be used."""
        return self.reason == GOOD


def correlated_pixels(found: Sequence[ViewComparison], otherwise: float) -> float:
    """Return the number of pixels that err together, 1 where all residuals are independent.

    The pixels of a view are summed in pieces of scan order. Were residuals independent, the gradient g of a piece would
    scatter by sigma^2 H of that piece, so that the sum of g' H^-1 g / sigma^2 over all pieces, H of the whole view,
    would be 8 (pose, gain and bias), less what a fit takes away: gradients are those at the minimum of the view
    alone. Correlation multiplies it (the scalar form of cluster-robust covariance). `otherwise` is returned where there
    are too few pieces.
    """
    total = expected = 0.0
    for view in found:
        if len(view.pieces) > 1 and np.all(np.isfinite(view.pieces)):
            H, g = unpack(view.pieces)
            inverse = scaled_inverse(H.sum(axis=0))
            g = g - H @ (inverse @ g.sum(axis=0))
            total += float(np.sum((g @ inverse) * g)) / view.sigma**2
            expected += NUM_COLUMNS * (1.0 - 1.0 / len(view.pieces))
    return max(1.0, total / expected) if expected else otherwise


def unpack(pieces: Array) -> tuple[Array, Array]:
    """Return H (P, 8, 8) and g (P, 8) of sums (P, NUM_SUMS), over (v, omega) of the reference, gain and bias."""
    products = np.zeros((len(pieces), NUM_COLUMNS + 1, NUM_COLUMNS + 1))
    rows, columns = np.triu_indices(NUM_COLUMNS + 1)
    products[:, rows, columns] = products[:, columns, rows] = pieces[:, : len(rows)]
    return products[:, :-1, :-1], products[:, :-1, -1]


def classify(descent: Descent, iterations: int, overlap: float, params: RegistrationParams, known: Array) -> Alignment:
    """Say what was found by the comparison of all views, after so many iterations in all.

    `known` (6, 6) is the information on the pose that does not come from the images.
    """
    state, found = descent.state, descent.found
    num_pixels = sum(view.num_visible for view in found)
    nothing = Alignment(
        T_world_camera=state.T_world_body.orthonormal(),  # the first guess was a product of many
        covariance=UNKNOWN,
        reason=LOW_OVERLAP,
        iterations=iterations,
        num_pixels=num_pixels,
        overlap=overlap,
        inlier_share=0.0,
        mad=0.0,
        ncc=0.0,
        gains=tuple(state.light[:, 0].tolist()),
        biases=tuple(state.light[:, 1].tolist()),
    )
    if num_pixels < params.min_pixels or overlap < params.min_overlap:
        return nothing
    mad = sum(view.mad * view.num_visible for view in found) / num_pixels
    inlier_share = sum(view.num_inliers for view in found) / num_pixels
    compared = replace(nothing, inlier_share=inlier_share, mad=mad, ncc=_correlation(found, state))
    correlated = correlated_pixels(found, params.correlated_pixels)
    covariance, condition = _covariance(normal_matrix(found), correlated * known)
    if condition > params.max_condition:
        return replace(compared, reason=LOW_TEXTURE)
    reason = GOOD
    if descent.motion > STUCK * params.min_step:
        reason = NO_CONVERGENCE
    elif mad > params.max_mad:
        reason = OUTLIERS
    return replace(compared, reason=reason, covariance=covariance * correlated)


def normal_matrix(found: Sequence[ViewComparison]) -> Array:
    """Return H over (xi, gain 1, bias 1, ...) of the compared views together (M15 eq. 19, 31)."""
    n = 6 + 2 * len(found)
    H, g = np.zeros((n, n)), np.zeros(n)
    for index, view in enumerate(found):
        h, q = (one.sum(axis=0) for one in unpack(view.pieces))
        kernels.to_body_tangent(view.T_body_reference, h, q)
        kernels.join_view(index, h, q, view.sigma, H, g)
    return H


def _covariance(H: Array, known: Array) -> tuple[Array, float]:
    """Return the covariance of the pose, were all pixels independent, and the condition of the scaled normal matrix.

    Light is eliminated: what it could explain is not known of the pose.
    """
    pose, cross, light = H[:6, :6], H[:6, 6:], H[6:, 6:]
    return inverse_and_condition(pose - cross @ np.linalg.solve(light, cross.T) + known)


def _correlation(found: Sequence[ViewComparison], state: AlignmentState) -> float:
    """Return the normalised cross correlation of reference and warped image over all visible pixels (M15 5.4).

    Views count as they do in the alignment, by the inverse of their residual's deviation.
    """
    covariance = variance_reference = variance_warped = 0.0
    for view, gain in zip(found, state.light[:, 0].tolist(), strict=True):
        if not view.num_visible:
            continue
        reference, current, product, square_reference, square_current = view.correlation
        mean, weight = current / view.num_visible, 1.0 / view.sigma**2
        covariance += weight * gain * (product - reference * mean)
        variance_reference += weight * (square_reference - reference**2 / view.num_visible)
        variance_warped += weight * gain**2 * (square_current - current * mean)
    norm = variance_reference * variance_warped
    return covariance / float(np.sqrt(norm)) if norm > 0 else 0.0
