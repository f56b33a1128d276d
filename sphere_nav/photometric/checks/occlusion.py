"""Does an occlusion, a part of the view that does not show the map, bias the pose?

Something before the camera that moves with it - a load, a hand, a bonnet, a queue - is no outlier to a robust weight
once it fills a third of the view: its edges hold the pose back while the vehicle goes on. The evidence: over a grid of
cells of the image, the mean cosine between the gradients of image and references. Cells that show the map agree, cells
that show something else do not, whatever pose has been found. Faint gradients, noise, edges seen from elsewhere and
another resolution make pixels of a cell scatter: it is occluded only where its mean is surely too low for that scatter.
The pose by the agreeing cells alone, found by a few steps, says how far the occluded ones bias it.
"""

from __future__ import annotations

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
from sphere_nav.photometric.pixels.samples import Sample, Sampler, cell_of, cosines_by_cell


def find_occlusion_bias(sampler: Sampler, sample: Sample, T_world_body: SE3) -> PoseBias:
    """Return the bias at an aligned pose; where a part is occluded, sample pixels anew on the way to the one without.

    The share is that of the texture, of the references or of the image, in cells that do not agree: a pale wall has
    none to lose. Gradients are those of the reference: of the image the gain is biased, too.
    """
    share, kept = keep_agreeing(sample)
    T_bias = SE3.identity()
    for _ in range(BIAS_STEPS if share >= OCCLUSION_SHARE else 0):
        if len(kept) <= MIN_VISIBLE_SHARE * len(sample):
            break
        step = solve_robustly(*linearize_samples(replace(kept, of_image=kept.of_reference)))[0][:6]
        T_bias = T_bias @ SE3.exp(step)
        if _motion(kept, step) < LAST_OCCLUSION_STEP_RAD:
            break
        sample = sampler(T_world_body @ T_bias)
        _, kept = keep_agreeing(sample)
    return PoseBias(share, T_bias.log())


def keep_agreeing(sample: Sample) -> tuple[float, Sample]:
    """Return the share 0..1 of the texture in cells that do not agree, and the pixels of the others."""
    part = sample.where(_cells_that_agree(sample)[cell_of(sample, CELLS)])
    share = np.max(1.0 - _strength(part) / np.maximum(_strength(sample), TINY))
    return float(share), part.of_views(MIN_VIEW_PIXELS)


def _strength(sample: Sample) -> Array:
    """Return the sums of squared gradients by the angle, (2,): of the reference, of the image."""
    gradients = sample.of_reference, sample.of_image
    return np.array([float(sample.range_m**2 @ np.einsum("ni,ni->n", rows, rows)) for rows in gradients])


def _cells_that_agree(sample: Sample) -> NDArray[np.bool_]:
    """Return for each cell whether it shows what the references do; true where that is not sure."""
    found = cosines_by_cell(sample, CELLS, MIN_CELL_PIXELS)
    scatter = (found.weight * (found.cosine - found.mean[found.cell])) ** 2
    variance = np.bincount(found.cell, scatter, len(found.total)) / np.maximum(found.total, TINY) ** 2
    return ~found.known | (found.mean + CELL_SIGMAS * np.sqrt(variance) >= MIN_COSINE_RATIO * found.typical)


def _motion(sample: Sample, step: Array) -> float:
    """Return the median angle by which a step moves points, seen from the body."""
    motion = step[:3] + np.cross(step[3:], sample.points)
    return float(np.median(np.linalg.norm(motion, axis=1) / np.linalg.norm(sample.points, axis=1)))
