"""Pictures of many cells as spectra over azimuth, kept in bytes: correlations for all headings are products of them."""

from __future__ import annotations

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from mcl_depth.constants import FINENESS, NUM_FREQUENCIES
from mcl_depth.likeness import kernels

Spectra = NDArray[np.complex64]
Codes = NDArray[np.int8]
Curves = NDArray[np.float32]
Image = NDArray[np.float32]


def spectra_of(pictures: Image, count: int = NUM_FREQUENCIES) -> Spectra:
    """Return the lowest spectra (..., F, P) over azimuth of pictures (..., n, H, W), row by row: P = n H."""
    spectra = scipy.fft.rfft(pictures, axis=-1)[..., :count]
    merged = spectra.reshape(*spectra.shape[:-3], -1, spectra.shape[-1])
    return np.ascontiguousarray(np.swapaxes(merged, -1, -2), np.complex64)


def encode(spectra: Spectra) -> tuple[Codes, NDArray[np.float32]]:
    """Return spectra (N, F, P) in bytes (N, F, 2 P), real, then imaginary parts, and what a code of one is (N, F)."""
    parts = np.concatenate([spectra.real, spectra.imag], axis=2)
    scales = np.maximum(np.abs(parts).max(axis=2) / np.float32(127.0), np.float32(1e-12))
    return np.rint(parts / scales[..., None]).astype(np.int8), scales


def correlate(
    codes: Codes, scales: NDArray[np.float32], slots: NDArray[np.int64], spectra: Spectra, num_headings: int
) -> Curves:
    """Return the correlation (M, FINENESS num_headings), evenly around, of cells in `slots` with an image's spectra.

    Cells as of `encode`; spectra (F, P). To be divided by the width of the pictures.
    """
    products = kernels.correlate_codes(codes, scales, slots, spectra)
    curves: Curves = scipy.fft.irfft(products, FINENESS * num_headings, axis=1, norm="forward")
    return curves


def best_around(curves: Curves) -> Curves:
    """Return every heading of curves (N, FINENESS A), (N, A): the best within half a step of it."""
    reach = FINENESS // 2
    best: Curves = np.max([np.roll(curves, step, axis=1) for step in range(-reach, reach + 1)], axis=0)
    return best[:, ::FINENESS]
