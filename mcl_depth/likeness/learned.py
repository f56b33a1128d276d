"""The learned likeness: feature maps of two trained networks, correlated over azimuth (`encoder.py`).

It takes the place of gradients and eq. 2 for whole panoramas, at each particle and in the survey of the map. All of the
filter around it stays: joint evidence and its false-alarm rate, compass, particles.
"""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from mcl_depth.constants import CHANCE, FINENESS, NUM_FREQUENCIES
from mcl_depth.likeness.depth_cache import Stack
from mcl_depth.likeness.spectra import (
    BATCH,
    Curves,
    Image,
    best_around,
    correlate,
    curves_of,
    encode_cells,
    spectra_of,
)

ABOVE_MEAN = range(1, NUM_FREQUENCIES)  # the mean over azimuth tells no heading


def pack(features: Image) -> Stack:
    """Return features (M, C, h, w) of depth panoramas in bytes: codes int8 in units of scale (M,)."""
    stack = np.empty(len(features), [("scale", np.float32), ("codes", np.int8, features.shape[1:])])
    stack["scale"] = np.maximum(np.abs(features).max(axis=(1, 2, 3)) / np.float32(127.0), np.float32(1e-12))
    stack["codes"] = np.round(features / stack["scale"][:, None, None, None])
    return stack


def unpack(stack: Stack) -> Image:
    """Return the features (M, C, h, w)."""
    features: Image = stack["codes"] * stack["scale"][:, None, None, None]
    return features


def compare_learned(visual: Image, stack: Stack, slots: NDArray[np.int64], num_alpha: int) -> Curves:
    """Return the similarity of features (C, h, w) with those in `slots` (M,) at all headings, (M, num_alpha).

    The mean of a curve is that of eq. 2 for images that have nothing to do with each other. Curves are smoothed over
    a step of headings, so that what lies between two of them is not missed.
    """
    image = spectra_of(visual, ABOVE_MEAN)  # (F, P)
    step = 2.0 * np.pi / num_alpha
    smooth = np.float32(0.5) * (1.0 + np.cos(np.minimum(np.array(ABOVE_MEAN) * 0.5 * step, np.pi)))
    image *= smooth[:, None].astype(np.float32)
    curves = np.empty((len(slots), num_alpha), np.float32)
    width = visual.shape[-1]
    for first in range(0, len(slots), BATCH):
        depths = spectra_of(unpack(stack[slots[first : first + BATCH]]), ABOVE_MEAN)  # (n, F, P)
        products = np.einsum("fp,nfp->nf", image, depths.conj(), optimize=True)
        curves[first : first + BATCH] = curves_of(products, ABOVE_MEAN.start, 2 * num_alpha)[:, ::2]
    return (np.float32(CHANCE) + curves / np.float32(width)).astype(np.float32)


class LearnedFilter(NamedTuple):
    """Spectra of N cells, ready for images.

    codes (N, F, 2 P) int8: real, then imaginary parts of the spectra of all channels row by row, P = C h; scales
    (F, P): what a code of one is.
    """

    codes: NDArray[np.int8]
    scales: NDArray[np.float32]

    @classmethod
    def of(cls, stack: Stack, slots: NDArray[np.integer]) -> Self:
        """Return the filter for the cells whose features are in `slots` (N,) of a stack; -1 fits nothing."""
        return cls(*encode_cells(stack, slots, unpack, ABOVE_MEAN))

    def curves(self, visual: Image, num_headings: int, rows: NDArray[np.int64] | None = None) -> Curves:
        """Return how well features (C, h, w) of an image fit, (N, num_headings), in units of its own.

        Headings as those of eq. 2, the best within half a step of each; `rows`: of some cells only.
        """
        weights = spectra_of(visual, ABOVE_MEAN) * self.scales
        return best_around(correlate(self.codes, weights, rows, ABOVE_MEAN.start, FINENESS * num_headings), FINENESS)
