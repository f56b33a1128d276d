"""Correlations by spectra in bytes are those of the pictures."""

from __future__ import annotations

import numpy as np
import pytest

from mcl_depth.likeness.spectra import correlate, encode_cells, scales_of, spectra_of

CELLS, HEIGHT, WIDTH = 9, 6, 48
ALL = range(WIDTH // 2)


@pytest.fixture
def pictures():
    """Pictures (n, 2, H, W) without the highest frequency."""
    drawn = np.random.default_rng(2).standard_normal((CELLS, 2, HEIGHT, WIDTH)).astype(np.float32)
    return np.fft.irfft(np.fft.rfft(drawn)[..., ALL], WIDTH).astype(np.float32)


@pytest.mark.parametrize("frequencies", [ALL, range(1, WIDTH // 2)])
def test_the_correlation_around_is_the_sum_of_products(monkeypatch, pictures, frequencies):
    if frequencies.start:
        pictures = pictures - pictures.mean(axis=-1, keepdims=True)
    image, cells = pictures[0], pictures[1:]
    slots = np.arange(len(cells))
    slots[3] = -1
    monkeypatch.setattr("mcl_depth.likeness.spectra.BATCH", 5)
    codes, scales = encode_cells(cells, slots, lambda part: part, frequencies)
    found = correlate(codes, spectra_of(image, frequencies) * scales, None, frequencies.start, WIDTH) / WIDTH
    wanted = np.array([[np.vdot(np.roll(cell, shift, axis=-1), image) for shift in range(WIDTH)] for cell in cells])
    wanted[3] = 0.0
    np.testing.assert_allclose(found, wanted, atol=0.02 * np.abs(wanted).max())  # bytes
    some = correlate(codes, spectra_of(image, frequencies) * scales, np.array([6, 1]), frequencies.start, WIDTH)
    np.testing.assert_allclose(some / WIDTH, found[[6, 1]], rtol=1e-4, atol=1e-4)


def test_codes_are_scaled_by_cells_that_are_there(pictures):
    _, scales = encode_cells(pictures, np.array([4, -1, 2, -1]), lambda part: part, ALL)
    np.testing.assert_array_equal(scales, scales_of(spectra_of(pictures[[4, 2]], ALL)))
