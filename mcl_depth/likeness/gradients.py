"""Likeness by edges: eq. 2 of N17 for places one by one, the correlation of gradients for all cells of a map at once.

With c the cosine between the gradients of a pixel, the first term of eq. 2 is |c| |Gv| and the second |c| |Gd|:
s = sum |c| (|Gv| + |Gd|). A pixel without a gradient in one of the images counts nothing. So an edge of one picture
counts even where the other has none; of a whole panorama enough is left, of a part of it little.

In the correlation a pixel counts by the product of both magnitudes and by the cosine of the doubled angle between the
gradients (Granlund 1978: an edge has a direction, but no sign), and the sum is divided by the length of the depth
gradients in view, so that a place with many edges wins nothing by them. By spectra over azimuth that is quick: products
of them are the correlations at all headings.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mcl_depth.constants import CHANCE_SCALE, MIN_VIEW_SHARE, NUM_ENERGY_FREQUENCIES, ROOT
from mcl_depth.likeness import kernels
from mcl_depth.likeness.depth_cache import Stack
from mcl_depth.likeness.features import GradientFeatures, Image, code_gradients, depth_gradients, visual_features
from mcl_depth.likeness.spectra import Curves, best_around, correlate, encode, spectra_of
from mcl_depth.params import ComparisonParams


class Gradients:
    """The likeness of any image."""

    name = ""  # of what is kept on disk
    min_seen = 0.0  # share of the panorama that an image must show
    chance_scale = CHANCE_SCALE[0]  # of what a drive elsewhere reaches
    image = staticmethod(visual_features)

    def __init__(self, params: ComparisonParams) -> None:
        self._params = params

    def depths(self, ranges_m: Image) -> Stack:
        """Return coded gradients (`code_gradients`) of range panoramas (M, H, W) in m, and their spectra in bytes.

        codes: of both components of the doubled gradients, of length 1 in each cell; energies: of their squared length.
        """
        x, y, magnitudes = (
            np.stack(one) for one in zip(*(depth_gradients(r, self._params) for r in ranges_m), strict=True)
        )
        tensors = np.stack([double(*one) for one in zip(x, y, magnitudes, strict=True)])
        energies = np.sum(tensors**2, axis=1, keepdims=True)
        stack = dict(code_gradients(x, y, magnitudes))
        stack["codes"], stack["code_scales"] = encode(spectra_of(tensors))
        stack["energies"], stack["energy_scales"] = encode(spectra_of(energies, NUM_ENERGY_FREQUENCIES))
        return stack

    def compare(self, visual: GradientFeatures, stack: Stack, slots: NDArray[np.int64], num_headings: int) -> Curves:
        """Return eq. 2 for M panoramas of a stack, those in `slots`, and all headings, (M, num_headings)."""
        image = visual.x, visual.y, visual.magnitude, visual.is_seen.astype(np.float32)
        depths = stack["directions"], stack["magnitudes"], stack["scale"]
        return kernels.compare_headings_many(*image, *depths, slots, num_headings)

    def survey(self, visual: GradientFeatures, stack: Stack, slots: NDArray[np.int64], num_headings: int) -> Curves:
        """Return the correlation with cells in `slots` (M,), -1 fits nothing: (M, num_headings), in units of its own.

        Headings as those of eq. 2, the best around each. Windows and furniture have the strongest edges and no
        counterpart in a plan: magnitudes of the image count by their root.
        """
        seen = visual.is_seen.astype(np.float32)
        image = seen * double(visual.x, visual.y, visual.magnitude**ROOT)
        products = correlate(stack["codes"], stack["code_scales"], slots, spectra_of(image), num_headings)
        in_view = spectra_of(seen[None], NUM_ENERGY_FREQUENCIES)
        energies = correlate(stack["energies"], stack["energy_scales"], slots, in_view, num_headings) / seen.shape[1]
        least = max(MIN_VIEW_SHARE * float(seen.mean()), 1e-12)
        return best_around((products / np.sqrt(np.maximum(energies, least))).astype(np.float32))


def double(x: Image, y: Image, magnitude: Image) -> Image:
    """Return gradients (H, W) with their angles doubled (2, H, W), their squares summing to 1; x, y of length 1."""
    doubled = magnitude * np.stack([x**2 - y**2, 2.0 * x * y]).astype(np.float32)
    normalized: Image = doubled / np.float32(max(float(np.sqrt(np.sum(doubled**2))), 1e-12))
    return normalized
