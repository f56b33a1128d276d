"""By how much is the image larger about its centre than the lens says?

Of a wrong focal length a pose takes over most: a street that is seen 2 % too large is one that is nearer. Not all: what
is near and what is far ask for another step. So the stretch of each camera is solved for together with the pose, at an
aligned pose. A level much coarser than the finest one is used, where corners are shifted by few pixels. Each cell of
the view has a light of its own, with a slope: what a lamp does there is no motion. Cells are the independent
observations: how differently they pull is the deviation.

That holds for small stretches. Of a large one a part is found: with a lens that is so much longer the next image is
aligned anew, though that may fit less, until little is left. What an image tells then counts if it fits better. Of a
very large one the pose takes over even that part: where nothing is told, a lens that is far off is tried, and gone on
from where the image fits better at once.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from sphere_nav.estimation.least_squares import RIDGE, clustered_covariance, scaled_inverse, weigh
from sphere_nav.geometry import FrameMotion, Spherical
from sphere_nav.geometry.arrays import Array
from sphere_nav.photometric.align.esm import Alignment, register_rig
from sphere_nav.photometric.align.problem import RigImage
from sphere_nav.photometric.checks.structure import LeastSquares
from sphere_nav.photometric.constants import (
    CELLS,
    LENS_DOUBT,
    LENS_LEFT,
    LENS_LEVEL,
    LENS_REWEIGHTINGS,
    LENS_STEP,
    MAX_LENS_STEP,
    MIN_CELL_PIXELS,
    MIN_LENS_CELLS,
    MIN_SIGMA,
)
from sphere_nav.photometric.params import RegistrationParams, between
from sphere_nav.photometric.pixels.pyramid import magnify
from sphere_nav.photometric.pixels.samples import Sample, cell_of, sample_images, sum_by_cell

Steps = Mapping[str, int]  # by which the lens of each camera is longer
NO_STEPS: Steps = MappingProxyType({})


@dataclass(frozen=True, eq=False)
class Stretch:
    """The image of a camera is larger about its centre than its lens says, by a share with its standard deviation.

    by_share (6,) is xi of the body from where it was aligned to where it is, for each unit of the share.
    """

    camera: str
    share: float
    sigma: float
    by_share: Array


def find_stretches(
    images: Sequence[RigImage],
    alignment: Alignment,
    params: RegistrationParams,
    motion: FrameMotion | None = None,
    longer: Steps = NO_STEPS,
    *,
    far: int = 0,
    is_clear: bool = True,
) -> tuple[list[Stretch], Steps]:
    """Return the stretch of each camera in an alignment of `register_rig`, and how much longer the lenses are thought.

    `longer` is what was thought after the image before: of a lens that is far off the first images tell no stretch.
    `far`: by how many steps longer all are tried where nothing is told. Where something else pulls the alignment, it is
    not `is_clear`, only what other lenses explain better is returned.
    """
    finest = min(params.pyramid.finest + LENS_LEVEL, min(len(one.pyramid.levels) for one in images) - 1)
    coarse = between(params, finest=finest)
    told, misfit = measure_stretches(images, alignment, coarse, motion)
    by_told, most, longer = told if is_clear else [], 1 if longer else 0, longer or _steps(told)
    is_tried = not any(longer.values())
    longer = {one.camera: far for one in told} if is_tried else longer
    if not any(longer.values()):
        return by_told, {}
    seen = [replace(one, pyramid=magnify(one.pyramid, LENS_STEP ** longer.get(one.name, 0))) for one in images]
    here = register_rig(seen, alignment.T_world_camera, coarse, motion)
    found, remaining = measure_stretches(seen, here, coarse, motion)
    left = _steps(found)
    is_settled = max(map(abs, left.values()), default=0) <= most
    if not (found and here.is_converged) or ((is_settled or is_tried) and remaining > misfit * LENS_LEFT):
        return by_told, {}
    if not is_settled:
        return [], {name: longer.get(name, 0) + steps for name, steps in left.items()}
    by = {name: LENS_STEP**steps for name, steps in longer.items()}
    return [replace(one, share=(1.0 + one.share) * by.get(one.camera, 1.0) - 1.0) for one in found], longer


def _steps(found: Sequence[Stretch]) -> Steps:
    """Return by how many steps each lens is longer; none where that is not told."""
    shares = {one.camera: one.share * (abs(one.share) > LENS_DOUBT * one.sigma) for one in found}
    logs = {name: np.log1p(np.clip(share, -MAX_LENS_STEP, MAX_LENS_STEP)) for name, share in shares.items()}
    return {name: round(log / np.log(LENS_STEP)) for name, log in logs.items()}


def measure_stretches(
    images: Sequence[RigImage],
    alignment: Alignment,
    params: RegistrationParams,
    motion: FrameMotion | None = None,
) -> tuple[list[Stretch], float]:
    """Return the stretch of each camera, to first order, and the misfit, of images that have been aligned."""
    sample = sample_images(images, alignment.T_world_camera, alignment.light, params, motion)
    lenses = {k: one.name for k, one in enumerate(images) if not isinstance(one.pyramid.cameras[0], Spherical)}
    return solve_stretches(sample, lenses)


def solve_stretches(sample: Sample, lenses: Mapping[int, str]) -> tuple[list[Stretch], float]:
    """Return the stretch of the cameras that have a lens, named by their image, and the misfit of all.

    None and Inf where too few cells are seen. The misfit is the standard deviation of the residuals (M15 eq. 33), less
    what the light of their cells explains.
    """
    if not len(sample):
        return [], np.inf
    J = np.zeros((len(sample), 6 + len(lenses)))
    J[:, :6] = sample.by_pose
    for own, k in enumerate(lenses, 6):
        J[:, own] = np.where(sample.image == k, sample.by_stretch, 0.0)
    J, residual, cells = _without_light(sample, J)
    if len(np.unique(cells)) < MIN_LENS_CELLS:
        return [], np.inf
    x = np.zeros(J.shape[1])
    for _ in range(LENS_REWEIGHTINGS):
        weight, _ = weigh(residual + J @ x, MIN_SIGMA)
        inverse = scaled_inverse((weight[:, None] * J).T @ J)
        x = -inverse @ (J.T @ (weight * residual))
    gradients = (weight * (residual + J @ x))[:, None] * J
    sigma = np.sqrt(np.diagonal(clustered_covariance(inverse, gradients, cells, len(x))))
    by_share = inverse[:6, 6:] @ np.linalg.inv(inverse[6:, 6:])
    told = zip(lenses.values(), x[6:].tolist(), sigma[6:].tolist(), by_share.T, strict=True)
    return [Stretch(*one) for one in told], weigh(residual, 0.0)[1]


def _without_light(sample: Sample, J: Array) -> LeastSquares:
    """Return derivatives and residuals of the pixels without what the light of their cells explains, and the cells.

    That is a gain, a bias and its slopes, in each cell of each view on its own.
    """
    number = sample.view * math.prod(CELLS) + cell_of(sample, CELLS)
    kept = (np.bincount(number) >= MIN_CELL_PIXELS)[number]
    (_, number), (weight, _) = np.unique(number[kept], return_inverse=True), weigh(sample.residual, MIN_SIGMA)
    light = np.column_stack([sample.current - sample.current.mean(), np.ones(len(kept)), 0.5 * sample.at * CELLS])[kept]
    rows, weighted = np.column_stack([J, sample.residual])[kept], weight[kept, None] * light
    A, b = (sum_by_cell(number, weighted[:, :, None] * one[:, None]) for one in (light, rows))
    floor = RIDGE * np.trace(A, axis1=1, axis2=2)[:, None, None] * np.eye(light.shape[1])
    rows = rows - np.einsum("nl,nlk->nk", light, np.linalg.solve(A + floor, b)[number])
    return rows[:, :-1], rows[:, -1], number
