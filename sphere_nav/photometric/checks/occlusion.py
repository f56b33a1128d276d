"""Does an occlusion, a part of the view that does not show the map, bias the pose?

Something before the camera that moves with it - a load, a hand, a bonnet, a queue - is no outlier to a robust weight
once it fills a third of the view: its edges hold the pose back while the vehicle goes on. The evidence: over a grid of
cells of the image, the mean cosine between the gradients of image and references. Cells that show the map agree, cells
that show something else do not, whatever pose has been found. Faint gradients, noise, edges seen from elsewhere and
another resolution make pixels of a cell scatter: it is occluded only where its mean is surely too low for that scatter.
The pose by the agreeing cells alone, found by a few steps, says how far the occluded ones bias it.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import TINY, Array
from sphere_nav.photometric.checks.bias import PoseBias, linearize_samples, solve_robustly
from sphere_nav.photometric.constants import (
    BIAS_STEPS,
    CELL_SIGMAS,
    CELLS,
    LAST_OCCLUSION_STEP_RAD,
    MIN_CELL_PIXELS,
    MIN_COSINE_RATIO,
    MIN_VIEW_PIXELS,
    MIN_VISIBLE_SHARE,
    OCCLUSION_SHARE,
)
from sphere_nav.photometric.pixels.samples import CameraSamples, Sample, Sampler, cell_of, cosines_by_cell


def find_occlusion_bias(sampler: Sampler, cameras: CameraSamples, T_world_body: SE3) -> PoseBias:
    """Return the bias at an aligned pose; where a part is occluded, sample pixels anew on the way to the one without.

    The share is that of the texture, of the references or of the image, in cells that do not agree: a pale wall has
    none to lose.
    """
    share, kept = keep_agreeing(cameras)
    T_bias = SE3.identity()
    for _ in range(BIAS_STEPS if share >= OCCLUSION_SHARE else 0):
        problem = (
            linearize_samples(_by_reference(kept)) if _number(kept) > MIN_VISIBLE_SHARE * _number(cameras) else None
        )
        if problem is None:
            break
        step = solve_robustly(*problem)[0][:6]
        T_bias = T_bias @ SE3.exp(step)
        if _motion(kept, step) < LAST_OCCLUSION_STEP_RAD:
            break
        cameras = sampler(T_world_body @ T_bias)
        _, kept = keep_agreeing(cameras)
    return PoseBias(share, T_bias.log())


def _by_reference(cameras: CameraSamples) -> CameraSamples:
    """Return the pixels with the gradients of the reference for those of the image, whose gain is biased, too."""
    return [(place, replace(one, of_image=one.of_reference)) for place, one in cameras]


def _number(cameras: CameraSamples) -> int:
    """Return how many pixels there are."""
    return sum(len(sample) for _, sample in cameras)


def keep_agreeing(cameras: CameraSamples) -> tuple[float, CameraSamples]:
    """Return the share 0..1 of the texture in cells that do not agree, and the pixels of the others."""
    kept: list[tuple[SE3, Sample]] = []
    strength = np.zeros((2, 2))  # of references and image: all of it, what agrees
    for place, sample in cameras:
        part = sample.where(_cells_that_agree(sample)[cell_of(sample, CELLS)])
        strength += [_strength(sample), _strength(part)]
        kept.append((place, part.of_views(MIN_VIEW_PIXELS)))
    return float(np.max(1.0 - strength[1] / np.maximum(strength[0], TINY))), kept


def _strength(sample: Sample) -> Array:
    """Return the sums of squared gradients by the angle, (2,): of the reference, of the image."""
    square = np.einsum("ni,ni->n", sample.points, sample.points)
    gradients = sample.of_reference, sample.of_image
    return np.array([float(square @ np.einsum("ni,ni->n", rows, rows)) for rows in gradients])


def _cells_that_agree(sample: Sample) -> NDArray[np.bool_]:
    """Return for each cell of an image whether it shows what the references do; true where that is not sure."""
    found = cosines_by_cell(sample, CELLS, MIN_CELL_PIXELS)
    scatter = (found.weight * (found.cosine - found.mean[found.cell])) ** 2
    variance = np.bincount(found.cell, scatter, math.prod(CELLS)) / np.maximum(found.total, TINY) ** 2
    return ~found.known | (found.mean + CELL_SIGMAS * np.sqrt(variance) >= MIN_COSINE_RATIO * found.typical)


def _motion(cameras: CameraSamples, step: Array) -> float:
    """Return the median angle by which a step moves points, seen from the body."""
    points = np.concatenate([place.apply(sample.points) for place, sample in cameras])
    motion = step[:3] + np.cross(step[3:], points)
    return float(np.median(np.linalg.norm(motion, axis=1) / np.linalg.norm(points, axis=1)))
