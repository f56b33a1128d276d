"""READ FIRST. Direct registration of images with their references (M15 sections 2 and 5.1).

Coarse to fine: choose the salient pixels that the cameras see, then descend - warp and compare, weigh and sum, solve,
update - until the increments are small; at the end classify: overlap, texture, outliers, convergence, covariance. A
single camera is a rig of one. How many pixels count as one independent observation is measured by how differently parts
of the image bias the pose.

Beside it a pure rotation between two images of one camera, from the coarsest level alone (section 5.2, eq. 20).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sphere_nav.estimation.least_squares import inverse_and_condition, scaled_inverse
from sphere_nav.geometry import SE3, Camera, FrameMotion
from sphere_nav.geometry.arrays import Array, Floats
from sphere_nav.geometry.cameras.camera import pixel_grid
from sphere_nav.photometric.align.descent import kernels
from sphere_nav.photometric.align.iteration.kernels import BLOCK, GRAY, NUM_COLUMNS, SIDE
from sphere_nav.photometric.align.problem import (
    MAX_VIEWS,
    NO_EXPECTATION,
    ROBUST,
    AlignmentState,
    Descent,
    Expectation,
    Problem,
    RigImage,
    ViewComparison,
    image_overlap,
    rows_of,
    share_pixels,
)
from sphere_nav.photometric.constants import MIN_VIEW_PIXELS, STUCK, TURN_PIXELS
from sphere_nav.photometric.params import RegistrationParams
from sphere_nav.photometric.pixels.pyramid import Level, Pyramid, in_blocks
from sphere_nav.photometric.pixels.reference import Reference, View, prepare_level


def register_rig(
    images: Sequence[RigImage],
    T_world_body: SE3,
    params: RegistrationParams | None = None,
    motion: FrameMotion | None = None,
    expected: Expectation = NO_EXPECTATION,
) -> Alignment:
    """Align the images of the cameras of a body with references that they overlap, from a first guess of its pose.

    Eq. 4-8, 18-19, 30-35. Several references are aligned at once; the cameras, and the references of each, share
    `max_pixels` (section 5.1.3). Gains and biases come camera by camera. `motion` is that of the body within a frame of
    a rolling shutter; it follows the pose from level to level, and once more at the finest. `expected`: what is known
    of the pose beforehand. Raises ValueError without images, for an image without views, and for one with more than
    `MAX_VIEWS`.
    """
    params = params or RegistrationParams()
    _check(images)
    share, state, iterations = share_pixels(params, len(images)), _start(images, T_world_body), 0
    coarsest = min(params.pyramid.coarsest, max(len(image.pyramid.levels) for image in images) - 1)
    finest = min(params.pyramid.finest, coarsest)
    for index in [*range(coarsest, finest - 1, -1), *([finest] if motion is not None else [])]:
        problem = Problem.choose_pixels(images, index, state.T_world_body, share, motion, expected)
        limit = params.max_iterations_fine if index == finest else params.max_iterations_coarse
        descent = problem.descend(state, limit)
        state, iterations = descent.state, iterations + descent.iterations
    return _judge(images, descent, iterations, params, expected)


def register(
    pyramid: Pyramid,
    views: Sequence[View],
    T_world_camera: SE3,
    params: RegistrationParams | None = None,
    motion: FrameMotion | None = None,
    expected: Expectation = NO_EXPECTATION,
) -> Alignment:
    """Align the image of one camera, as `register_rig` does; pose and motion are those of the camera."""
    return register_rig([RigImage(pyramid, views=tuple(views))], T_world_camera, params, motion, expected)


def evaluate(
    pyramid: Pyramid, views: Sequence[View], T_world_camera: SE3, params: RegistrationParams | None = None
) -> Alignment:
    """Return what `register` would report at a pose without moving it; ValueError as there."""
    params, images = params or RegistrationParams(), [RigImage(pyramid, views=tuple(views))]
    _check(images)
    problem, start = Problem.choose_pixels(images, 0, T_world_camera, params), _start(images, T_world_camera)
    *_, found = problem.compare(start)
    return _judge(images, Descent(start, 0, 0.0, is_determined=True, found=found), 0, params, problem.expected)


def _judge(
    images: Sequence[RigImage], descent: Descent, iterations: int, params: RegistrationParams, expected: Expectation
) -> Alignment:
    """Say what the last descent has found, after so many iterations."""
    T_world_body = descent.state.T_world_body
    overlaps = [image_overlap(image.pyramid.cameras, image.views, image.pose(T_world_body)) for image in images]
    known, _ = expected.pull_at(T_world_body)
    return classify(descent, iterations, float(np.mean(overlaps)), params, known)


def _start(images: Sequence[RigImage], T_world_body: SE3) -> AlignmentState:
    return AlignmentState.start(T_world_body, sum(len(image.views) for image in images))


def _check(images: Sequence[RigImage]) -> None:
    if not images:
        raise ValueError("images: expected at least one, found none")
    for image in images:
        if not 1 <= len(image.views) <= MAX_VIEWS:
            found = len(image.views)
            raise ValueError(f"views: expected at least one reference and at most {MAX_VIEWS}, found {found}")


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


def register_rotation(now: Pyramid, before: Pyramid, params: RegistrationParams | None = None) -> SE3:
    """Return T_before_now, a pure rotation, between two images of the same camera; identity where nothing is seen.

    At the coarsest level rotation dominates: every pixel is taken as infinitely far.
    """
    params = params or RegistrationParams()
    level = now.levels[-1]
    everywhere_far = np.full((level.camera.height, level.camera.width), np.inf, np.float32)
    pixels = prepare_level(before.levels[-1], everywhere_far, params.far)
    image = RigImage(Pyramid((level,)), views=(View(Reference((pixels,)), SE3.identity()),))
    problem = Problem.choose_pixels([image], 0, SE3.identity(), params)
    descent = problem.descend(AlignmentState.start(SE3.identity(), 1), params.max_iterations_fine, is_rotation=True)
    return descent.state.T_world_body if descent.is_determined else SE3.identity()


def correlation_after_turn(now: Pyramid, before: Pyramid, R_before_now: Array) -> float | None:
    """Return the correlation -1...1 of an image with an earlier one of the same camera, turned; None for too little.

    A few hundred pixels of the coarsest level are compared: a tenth of the time that `register_rotation` takes.
    """
    earlier = before.levels[-1]
    (column, row), rays = _sample(earlier.camera)
    pixels = np.zeros((BLOCK // SIDE, len(row)), np.float32)
    pixels[:3], pixels[GRAY // SIDE] = rays, earlier.image[row, column + earlier.pad]
    found, number = correlate(in_blocks(pixels), SE3.from_parts(R_before_now.T, np.zeros(3)), now.levels[-1])
    return found if number >= MIN_VIEW_PIXELS else None


def correlate(blocks: Floats, T_camera_reference: SE3, level: Level) -> tuple[float, int]:
    """Return the correlation -1...1 of pixels with an image from a pose, and of how many; of 0 where nothing varies."""
    facts, pieces = np.empty(kernels.NUM_FACTS), np.empty((kernels.NUM_PIECES, kernels.NUM_SUMS))
    image = level.kernel_camera, level.samples
    kernels.examine(blocks, rows_of(T_camera_reference), *image, 1.0, 0.0, *ROBUST, facts, pieces)
    number = max(int(facts[kernels.NUM_VISIBLE]), 1)
    reference, current, product, square_reference, square_current = facts[kernels.SUM_REFERENCE :].tolist()
    norm = (square_reference - reference**2 / number) * (square_current - current**2 / number)
    return ((product - reference * current / number) / norm**0.5, number) if norm > 0.0 else (0.0, 0)


@lru_cache(maxsize=16)
def _sample(camera: Camera) -> tuple[NDArray[np.int64], Floats]:
    """Return columns and rows (2, N) of pixels of a camera, and their rays (3, N)."""
    step = max(1, int(np.sqrt(camera.width * camera.height / TURN_PIXELS)))
    grid = pixel_grid(camera)[step // 2 :: step, step // 2 :: step].reshape(-1, 2)
    return grid.T.astype(np.int64), camera.unproject(grid).T.astype(np.float32)
