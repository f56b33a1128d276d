"""Pictures of many cells as spectra over azimuth, kept in bytes: correlations for all headings are products of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from mcl_depth.constants import CODE_RANGE, NUM_FREQUENCIES, NUM_SAMPLES
from mcl_depth.likeness import kernels
from mcl_depth.likeness.depth_cache import Stack
from mcl_depth.likeness.kernels import COSINES, NO_DIRECTION, SINES, SQUARES

Spectra = NDArray[np.complex64]
Codes = NDArray[np.int8]
Curves = NDArray[np.float32]
Image = NDArray[np.float32]

BATCH = 128  # cells whose spectra are made at once

FREQUENCIES = range(NUM_FREQUENCIES)


def _double_directions() -> tuple[Image, Image]:
    """Return cosine and sine of twice the angle of each code of a direction (256,); 0 where it is none."""
    is_direction = np.arange(len(COSINES)) != NO_DIRECTION
    cosines, sines = np.where(is_direction, COSINES**2 - SINES**2, 0.0), 2.0 * COSINES * SINES
    return cosines.astype(np.float32), sines.astype(np.float32)


DOUBLE_COSINES, DOUBLE_SINES = _double_directions()


def spectra_of(pictures: Image, frequencies: range) -> Spectra:
    """Return spectra (..., F, P) over azimuth of pictures (..., n, H, W), row by row: P = n H."""
    spectra = scipy.fft.rfft(pictures, axis=-1)[..., frequencies.start : frequencies.stop]
    merged = spectra.reshape(*spectra.shape[:-3], -1, spectra.shape[-1])
    return np.ascontiguousarray(np.swapaxes(merged, -1, -2), np.complex64)


def magnitudes_of(stack: Stack) -> Image:
    """Return the magnitudes of depth gradients (M, H, W)."""
    magnitudes: Image = stack["scale"][:, None, None] * SQUARES[stack["magnitudes"]]
    return magnitudes


def encode_cells(
    stack: Stack, slots: NDArray[np.integer], pictures_of: Callable[[Stack], Image], frequencies: range
) -> tuple[Codes, NDArray[np.float32]]:
    """Return codes (N, F, 2 P) of the pictures (n, ..., H, W) of cells in slots (N,) of a stack, and their scales.

    Real, then imaginary parts in units of the scales (F, P); 0 for slot -1.
    """

    def spectra_at(chosen: NDArray[np.integer]) -> Iterator[Spectra]:
        for first in range(0, len(chosen), BATCH):
            yield spectra_of(pictures_of(stack[chosen[first : first + BATCH]]), frequencies)

    known = slots[slots >= 0]
    scales = scales_of(np.concatenate(list(spectra_at(known[:: max(len(known) // NUM_SAMPLES, 1)]))))
    codes = np.empty((len(slots), len(scales), 2 * scales.shape[1]), np.int8)
    for number, spectra in enumerate(spectra_at(slots)):
        scaled = spectra / scales
        parts = np.concatenate([scaled.real, scaled.imag], axis=2)
        codes[number * BATCH : number * BATCH + len(parts)] = np.clip(np.round(parts), -127, 127)
    codes[slots < 0] = 0
    return codes, scales


def scales_of(samples: Spectra) -> NDArray[np.float32]:
    """Return what a code of one stands for (F, P), from spectra (N, F, P)."""
    deviations = np.sqrt(np.mean(np.abs(samples) ** 2, axis=0) / 2.0)
    return np.maximum(CODE_RANGE / 127.0 * deviations, 1e-12).astype(np.float32)


def correlate(codes: Codes, weights: Spectra, rows: NDArray[np.int64] | None, first: int, count: int) -> Curves:
    """Return the correlation (N, count), evenly around, of cells with an image's weights (F, P) in units of codes.

    first: the lowest of the F frequencies; `rows`: of some cells only. To be divided by the width of the pictures.
    """
    chosen = codes if rows is None else codes[rows]
    return curves_of(kernels.correlate_codes(chosen, weights.astype(np.complex64)), first, count)


def curves_of(spectra: Spectra, first: int, count: int) -> Curves:
    """Return the values (N, count), evenly around, of spectra (N, F) from a lowest frequency on."""
    full = np.zeros((len(spectra), count // 2 + 1), np.complex64)
    full[:, first : first + spectra.shape[1]] = spectra[:, : full.shape[1] - first]
    curves: Curves = scipy.fft.irfft(full, count, axis=1, norm="forward")
    return curves


def best_around(curves: Curves, fineness: int) -> Curves:
    """Return every heading of curves (N, fineness A), (N, A): the best within half a step of it."""
    reach = fineness // 2
    best: Curves = np.max([np.roll(curves, step, axis=1) for step in range(-reach, reach + 1)], axis=0)
    return best[:, ::fineness]
