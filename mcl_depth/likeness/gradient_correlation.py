"""How well a part of the sphere fits depth panoramas: the normalised correlation of their gradients.

Eq. 2 sums |cos| times either magnitude, so an edge of one picture counts even where the other has none; of a whole
panorama enough is left, of a part of it little. Here a pixel counts by the product of both magnitudes and by the cosine
of the doubled angle between the gradients (Granlund 1978: an edge has a direction, but no sign), and the sum is divided
by the length of the depth gradients in view, so that a place with many edges wins nothing by them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mcl_depth.likeness import kernels
from mcl_depth.likeness.features import Features, FeatureStack
from mcl_depth.likeness.spectra import DOUBLE_COSINES, DOUBLE_SINES, Curves, Image

MIN_SHARE = 0.1  # of the depth gradients that are expected in view: a view of next to nothing is taken to have these


def correlate_part(visual: Features, stack: FeatureStack, num_alpha: int, indices: NDArray[np.integer]) -> Curves:
    """Return the correlation, -1 to 1, of an image with the panoramas of `indices` for all headings, (M, num_alpha).

    Headings are those of eq. 2 (`comparison.similarity`).
    """
    seen = np.ones(visual.shape, np.float32) if visual.is_seen is None else visual.is_seen.astype(np.float32)
    tensors = (*double_gradients(visual), seen)
    tables = (DOUBLE_COSINES, DOUBLE_SINES, stack.directions, stack.magnitudes)
    found: Curves = kernels.correlate_tensors(*tensors, *tables, indices.astype(np.int64), MIN_SHARE, num_alpha)
    return found


def double_gradients(visual: Features) -> Image:
    """Return the gradients of an image with their angles doubled (2, H, W), their squares summing to 1."""
    both = [visual.magnitude * (visual.x**2 - visual.y**2), visual.magnitude * (2.0 * visual.x * visual.y)]
    doubled = np.stack(both).astype(np.float32)
    normalised: Image = doubled / np.float32(max(float(np.sqrt(np.sum(doubled**2))), 1e-12))
    return normalised
