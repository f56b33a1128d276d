"""How well a visual panorama fits a depth panorama, for all headings at once (N17 eq. 2).

With c the cosine between the gradients of a pixel, the first term of eq. 2 is |c| |Gv| and the second |c| |Gd|:
s = sum |c| (|Gv| + |Gd|). A pixel without a gradient in one of the images counts nothing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mcl_depth.likeness import kernels
from mcl_depth.likeness.features import FeatureStack, GradientFeatures

Similarities = NDArray[np.float32]


def num_alpha_for(step_deg: float) -> int:
    """Return how many headings a step makes; ValueError where it does not divide 360 degrees."""
    count = round(360.0 / step_deg) if step_deg > 0 else 0
    if count < 1 or abs(count * step_deg - 360.0) > 1e-6:
        raise ValueError(f"alpha step: expected a divisor of 360 deg, found {step_deg:g} deg")
    return count


def check_headings(step_deg: float, num_columns: int) -> None:
    """Refuse a step between headings that is no whole number of columns of the panorama; ValueError."""
    count = num_alpha_for(step_deg)
    if num_columns % count:
        column = 360.0 / num_columns
        raise ValueError(f"alpha step: expected a multiple of a column, {column:g} deg, found {step_deg:g} deg")


def similarity_many(
    visual: GradientFeatures, stack: FeatureStack, num_alpha: int, indices: NDArray[np.integer] | None = None
) -> Similarities:
    """Return eq. 2 for M panoramas of a stack (all, or those of `indices`) and all headings, (M, num_alpha)."""
    chosen = np.arange(len(stack)) if indices is None else np.asarray(indices, np.int64)
    arrays = (visual.x, visual.y, visual.magnitude, _seen(visual))
    coded = (stack.directions, stack.magnitudes, stack.scales)
    return kernels.compare_headings_many(*arrays, *coded, chosen.astype(np.int64), num_alpha)


def _seen(visual: GradientFeatures) -> NDArray[np.float32]:
    """Return 1 where a pixel is seen, (H, W); an empty array where all are."""
    return np.zeros((0, 0), np.float32) if visual.is_seen is None else visual.is_seen.astype(np.float32)
