"""Which parts of the view show the map, and could as many do so by chance?

Where parked cars have gone and others stand, the gradients of a part of the view agree with nothing: the mean over the
view falls as it does in a wrong place, and what has changed pulls the pose. So each cell of a grid is asked for itself:
of all shifts of the image by up to `REACH` pixels, at which do gradients of image and references agree best? At none
where the cell shows the map and the pose is right; at any one where it shows something else, or where the place is
wrong. The cells whose best shift is none are then binomial. A pose has six numbers, so the fit alone can bring
`FITTED_CELLS` to agree; they do not count.

The pose by the agreeing cells alone, found by a few steps, is the one that is judged. Its covariance is that of how
differently those cells pull, so that far ones that are all alike do not pass for a view that holds the pose.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from sphere_nav.estimation.normal_equations import scaled_inverse
from sphere_nav.geometry import SE3, Camera
from sphere_nav.geometry.arrays import TINY, Array
from sphere_nav.photometric.align.esm import register_rig
from sphere_nav.photometric.align.judgement import UNKNOWN
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.photometric.checks import kernels
from sphere_nav.photometric.checks.bias import CameraSamples, Sampler, linearize_samples, solve_robustly
from sphere_nav.photometric.constants import (
    BIAS_STEPS,
    CELLS,
    FITTED_CELLS,
    LAST_SUPPORT_STEP,
    MAX_CHANCE,
    MAX_PREDICTED_CHANCE,
    MIN_CELL_PIXELS,
    NEAR_SHIFT,
    PREDICTED_LEVELS,
    REACH,
    STRENGTH_QUANTILE,
)
from sphere_nav.photometric.params import RegistrationParams
from sphere_nav.photometric.pixels.pyramid import Level
from sphere_nav.photometric.pixels.samples import Sample

COLUMNS, ROWS = CELLS
P_NEAR = float((2 * NEAR_SHIFT + 1) ** 2 / (2 * REACH + 1) ** 2)  # that the best of all shifts is none, by chance
FIELDS = ("points", "of_reference")  # of a sample
DERIVATIVE_STEP = 1e-3  # of the range, by which a point is moved; to a hundredth of a pixel


@dataclass(frozen=True, eq=False)
class Support:
    """How many cells there are and agree, the chance of as many, and xi (6,) from the aligned pose to theirs.

    covariance (6, 6) is that of their pose, by how differently they pull it.
    """

    num_cells: int = 0
    num_agreeing: int = 0
    chance: float = 1.0
    xi: Array = field(default_factory=lambda: np.zeros(6))
    covariance: Array = field(default_factory=UNKNOWN.copy)

    @property
    def is_proven(self) -> bool:
        """Whether more cells agree than in a wrong place."""
        return self.chance <= MAX_CHANCE


NO_SUPPORT = Support()


def find_support(
    images: Sequence[RigImage],
    sampler: Sampler,
    T_world_body: SE3,
    params: RegistrationParams,
    T_predicted: SE3 | None = None,
) -> Support:
    """Return the support of an aligned pose; where it is not proven, that of a predicted one, which may be.

    What has changed can draw the alignment away from a prediction that was good, at coarse levels most of all: the
    prediction is asked as it is, and aligned at the finest levels alone. It needs a smaller chance, as the alignment
    speaks against it. Either way the pose is the one that the agreeing cells find from there.
    """
    levels = _levels(images, params)
    aligned = _follow(levels, sampler, T_world_body, params)
    if aligned.is_proven or T_predicted is None:
        return aligned
    for start in _predictions(images, params, T_predicted):
        found = _follow(levels, sampler, start, params)
        if found.chance <= MAX_PREDICTED_CHANCE:
            return replace(found, xi=(T_world_body.inverse() @ start @ SE3.exp(found.xi)).log())
    return aligned


def _predictions(images: Sequence[RigImage], params: RegistrationParams, T_predicted: SE3) -> Iterator[SE3]:
    """Yield a predicted pose as it is, and aligned without the coarse levels."""
    yield T_predicted
    for number in PREDICTED_LEVELS:
        yield register_rig(images, T_predicted, _finest_only(number, params)).T_world_camera


@cache
def _finest_only(number: int, params: RegistrationParams) -> RegistrationParams:
    """Return the parameters of an alignment at so many of the finest levels."""
    return replace(params, pyramid=replace(params.pyramid, coarsest=params.pyramid.finest + number - 1))


def _follow(levels: Sequence[Level], sampler: Sampler, T_world_body: SE3, params: RegistrationParams) -> Support:
    """Return the support of the pose that the agreeing cells find; pixels are sampled anew after each step."""
    T_step, votes, covariance = SE3.identity(), _vote(levels, sampler(T_world_body)), NO_SUPPORT.covariance
    for _ in range(BIAS_STEPS):
        problem = linearize_samples(votes.kept, ()) if votes.chance <= MAX_CHANCE else None
        if problem is None:
            break
        step, remaining, weight = solve_robustly(*problem, params)
        covariance = _covariance(problem[0], remaining, weight, votes.owner)
        if step[:6] @ scaled_inverse(covariance) @ step[:6] < LAST_SUPPORT_STEP**2:
            break
        T_step = T_step @ SE3.exp(step[:6])
        votes = _vote(levels, sampler(T_world_body @ T_step))
    return Support(votes.num_cells, votes.num_agreeing, votes.chance, T_step.log(), covariance)


def exclude_changes(images: Sequence[RigImage], sampler: Sampler, params: RegistrationParams) -> Sampler:
    """Return the sampler of the pixels in cells that agree, no others."""
    levels = _levels(images, params)
    return lambda T_world_body: _vote(levels, sampler(T_world_body)).kept


def _levels(images: Sequence[RigImage], params: RegistrationParams) -> list[Level]:
    """Return the level of each image that pixels are sampled of."""
    return [image.pyramid.levels[min(params.pyramid.finest, len(image.pyramid.levels) - 1)] for image in images]


@dataclass(frozen=True, eq=False)
class Votes:
    """The cells of all images, those that agree, the pixels in them, and the cell of each of these pixels."""

    num_cells: int
    num_agreeing: int
    kept: CameraSamples
    owner: NDArray[np.int64]

    @property
    def chance(self) -> float:
        """The probability that as many agree in a wrong place."""
        from scipy.special import bdtrc  # what only reads bags does without it

        number, agreeing = self.num_cells - FITTED_CELLS, self.num_agreeing - FITTED_CELLS
        return float(bdtrc(agreeing - 1, number, P_NEAR)) if 0 < agreeing <= number else 1.0


def _vote(levels: Sequence[Level], cameras: CameraSamples) -> Votes:
    """Return what the cells of each image say."""
    num_cells = num_agreeing = 0
    kept, owners = [], [np.zeros(0, np.int64)]
    for index, (level, (place, samples)) in enumerate(zip(levels, cameras, strict=True)):
        is_known, agrees, cell = _vote_of_image(level, samples)
        num_cells, num_agreeing = num_cells + int(is_known.sum()), num_agreeing + int(agrees.sum())
        cells = np.split(cell, np.cumsum([len(sample.residual) for sample in samples])[:-1]) if samples else []
        kept.append((place, [sample.where(agrees[own]) for sample, own in zip(samples, cells, strict=True)]))
        owners.append(index * COLUMNS * ROWS + cell[agrees[cell]])
    return Votes(num_cells, num_agreeing, kept, np.concatenate(owners))


def _vote_of_image(
    level: Level, samples: Sequence[Sample]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.int64]]:
    """Return which cells have pixels enough, which of them agree, and the cell of each pixel of all views."""
    camera, number, margin = level.camera, COLUMNS * ROWS, REACH + 1
    scores = np.zeros((number, 2 * REACH + 1, 2 * REACH + 1))
    if not samples:
        return np.zeros(number, bool), np.zeros(number, bool), np.zeros(0, np.int64)
    points, of_reference = (np.concatenate([getattr(one, name) for one in samples]) for name in FIELDS)
    place, gradient = _project(camera, points, of_reference)
    column, row = np.rint(place).astype(np.int32).T
    cell = (row * ROWS // camera.height * COLUMNS + column * COLUMNS // camera.width).clip(0, number - 1)
    inside = (column >= margin) & (column < camera.width - margin) & (row >= margin) & (row < camera.height - margin)
    strength = np.linalg.norm(gradient, axis=1)
    direction = (gradient / np.maximum(strength, TINY)[:, None]).astype(np.float32)
    weight = np.minimum(strength, np.quantile(strength, STRENGTH_QUANTILE)).astype(np.float32)
    pixels = column[inside] + np.int32(level.pad), row[inside], direction[inside], weight[inside]
    kernels.score_shifts(level.image, *pixels, cell[inside], REACH, scores)
    is_known = np.bincount(cell[inside], minlength=number) >= MIN_CELL_PIXELS
    best = np.stack(np.unravel_index(scores.reshape(number, -1).argmax(axis=1), scores.shape[1:]), axis=-1) - REACH
    return is_known, is_known & (np.abs(best).max(axis=1) <= NEAR_SHIFT), cell.astype(np.int64)


def _project(camera: Camera, points: Array, of_reference: Array) -> tuple[Array, Array]:
    """Return where points (N, 3) are in the image, (N, 2) px, and their gradients by the point as ones by px (N, 2)."""
    step = DERIVATIVE_STEP * np.linalg.norm(points, axis=1, keepdims=True)
    place = camera.project(points)[0]
    J = np.stack([(camera.project(points + step * axis)[0] - place) / step for axis in np.eye(3)], axis=-1)
    a, b = J[:, 0], J[:, 1]
    aa, ab, bb = (np.einsum("ni,ni->n", *pair) for pair in ((a, a), (a, b), (b, b)))
    ga, gb = np.einsum("ni,ni->n", a, of_reference), np.einsum("ni,ni->n", b, of_reference)
    found = np.stack([bb * ga - ab * gb, aa * gb - ab * ga], axis=-1) / np.maximum(aa * bb - ab**2, TINY)[:, None]
    return np.nan_to_num(place), np.nan_to_num(found)


def _covariance(J: Array, residual: Array, weight: Array, owner: NDArray[np.int64]) -> Array:
    """Return the covariance (6, 6) of the pose, cells being the independent observations (cluster-robust)."""
    H = scaled_inverse((weight[:, None] * J).T @ J)
    names, cell = np.unique(owner, return_inverse=True)
    pulls = np.zeros((len(names), J.shape[1]))
    np.add.at(pulls, cell, (weight * residual)[:, None] * J)
    freedom = len(names) / max(len(names) - J.shape[1], 1)
    return np.asarray((freedom * H @ (pulls.T @ pulls) @ H)[:6, :6], np.float64)
