"""How well a visual panorama fits a depth panorama, for all headings at once (N17 eq. 2).

With c the cosine between the gradients of a pixel, the first term of eq. 2 is |c| |Gv| and the second |c| |Gd|:
s = sum |c| (|Gv| + |Gd|). A pixel without a gradient in one of the images counts nothing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mcl_depth.likeness import kernels
from mcl_depth.likeness.depth_cache import Stack
from mcl_depth.likeness.features import GradientFeatures


def num_alpha_for(step_deg: float) -> int:
    """Return how many headings a step makes."""
    return round(360.0 / step_deg)


def check_headings(step_deg: float, num_columns: int) -> None:
    """Refuse a step between headings that is no whole number of columns, or does not divide a circle; ValueError."""
    count = num_alpha_for(step_deg)
    if num_columns % count or abs(count * step_deg - 360.0) > 1e-6:
        expected = f"a divisor of 360 deg and a multiple of a column, {360.0 / num_columns:g} deg"
        raise ValueError(f"heading_step_deg: expected {expected}, found {step_deg:g} deg")


def compare_gradients(
    visual: GradientFeatures, stack: Stack, slots: NDArray[np.int64], num_alpha: int
) -> NDArray[np.float32]:
    """Return eq. 2 for M panoramas of a stack, those in `slots`, and all headings, (M, num_alpha)."""
    image = visual.x, visual.y, visual.magnitude, visual.is_seen.astype(np.float32)
    depths = stack["directions"], stack["magnitudes"], stack["scale"]
    return kernels.compare_headings_many(*image, *depths, slots, num_alpha)
