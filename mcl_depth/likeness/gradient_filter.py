"""One image against every cell of a map at once: the correlation of gradients.

Eq. 2 sums |cos| times either magnitude, so an edge of one picture counts even where the other has none; of a whole
panorama enough is left, of a part of it little. So here a pixel counts by the product of both magnitudes and by the
cosine of the doubled angle between the gradients (Granlund 1978: an edge has a direction, but no sign), and the sum is
divided by the length of the depth gradients in view, so that a place with many edges wins nothing by them. By spectra
over azimuth that is quick: products of them are the correlations at all headings.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mcl_depth.constants import (
    MIN_VIEW_SHARE,
    NUM_ENERGY_FREQUENCIES,
    PART_FINENESS,
    ROOT,
)
from mcl_depth.likeness.depth_cache import Stack
from mcl_depth.likeness.features import GradientFeatures
from mcl_depth.likeness.spectra import (
    DOUBLE_COSINES,
    DOUBLE_SINES,
    FREQUENCIES,
    Curves,
    Image,
    best_around,
    correlate,
    encode_cells,
    magnitudes_of,
    spectra_of,
)

ENERGY_FREQUENCIES = range(NUM_ENERGY_FREQUENCIES)


def double_gradients(visual: GradientFeatures) -> Image:
    """Return the gradients of an image with their angles doubled (2, H, W), their squares summing to 1.

    Windows and furniture have the strongest edges and no counterpart in a plan: magnitudes count by their root.
    """
    magnitude = visual.magnitude**ROOT
    both = [magnitude * (visual.x**2 - visual.y**2), magnitude * (2.0 * visual.x * visual.y)]
    doubled = np.stack(both).astype(np.float32)
    normalized: Image = doubled / np.float32(max(float(np.sqrt(np.sum(doubled**2))), 1e-12))
    return normalized


class GradientFilter(NamedTuple):
    """Spectra of N cells, ready for images.

    codes (N, F, 2 P) int8: real, then imaginary parts of the spectra of both components of the doubled gradients row by
    row, P = 2 H, of length 1 in each cell; scales (F, P): what a code of one is. energies (N, E, 2 H), energy_scales
    (E, H): the same of the squared length.
    """

    codes: NDArray[np.int8]
    scales: NDArray[np.float32]
    energies: NDArray[np.int8]
    energy_scales: NDArray[np.float32]

    @classmethod
    def of(cls, stack: Stack, slots: NDArray[np.integer]) -> GradientFilter:
        """Return the filter for the cells whose features are in `slots` (N,) of a stack; -1 fits nothing."""
        tensors = encode_cells(stack, slots, _tensors_of, FREQUENCIES)
        return cls(*tensors, *encode_cells(stack, slots, _energies_of, ENERGY_FREQUENCIES))

    def curves(self, visual: GradientFeatures, num_headings: int, rows: NDArray[np.int64] | None = None) -> Curves:
        """Return how well an image fits, (N, num_headings), in units of its own; headings as those of eq. 2.

        `rows`: of some cells only. The best around each heading.
        """
        seen = visual.is_seen.astype(np.float32)
        count, width = PART_FINENESS * num_headings, seen.shape[1]
        weights = spectra_of(seen * double_gradients(visual), FREQUENCIES) * self.scales
        products = correlate(self.codes, weights, rows, 0, count)
        in_view = spectra_of(seen[None], ENERGY_FREQUENCIES) * self.energy_scales
        energies = correlate(self.energies, in_view, rows, 0, count) / width
        curves = products / np.sqrt(np.maximum(energies, max(MIN_VIEW_SHARE * float(seen.mean()), 1e-12)))
        return best_around(curves.astype(np.float32), PART_FINENESS)


def _tensors_of(part: Stack) -> Image:
    """Return the doubled gradients (n, 2, H, W) of cells."""
    magnitudes = _normalize(magnitudes_of(part))
    return np.stack([table[part["directions"]] * magnitudes for table in (DOUBLE_COSINES, DOUBLE_SINES)], axis=1)


def _energies_of(part: Stack) -> Image:
    """Return their squared length (n, 1, H, W)."""
    return np.square(_normalize(magnitudes_of(part)))[:, None]


def _normalize(magnitudes: Image) -> Image:
    """Return magnitudes (n, H, W) whose squares sum to 1 in each cell."""
    lengths = np.sqrt(np.sum(magnitudes**2, axis=(1, 2), keepdims=True))
    return magnitudes / np.maximum(lengths, np.float32(1e-12))
