"""Correlations by spectra in bytes are those of the pictures."""

from __future__ import annotations

import numpy as np

from mcl_depth.likeness.spectra import best_around, correlate, encode, spectra_of

CELLS, HEIGHT, WIDTH, FINENESS = 9, 6, 40, 5


def test_the_correlation_around_is_the_sum_of_products_and_the_best_around_each_heading_counts():
    drawn = np.random.default_rng(2).standard_normal((CELLS, 2, HEIGHT, WIDTH)).astype(np.float32)
    pictures = np.fft.irfft(np.fft.rfft(drawn)[..., : WIDTH // 2], WIDTH).astype(np.float32)
    image, cells, slots = pictures[0], pictures[1:], np.array([6, 1, -1, 0])
    found = correlate(*encode(spectra_of(cells)), slots, spectra_of(image), WIDTH // FINENESS) / WIDTH
    wanted = np.array([[np.vdot(np.roll(cell, s, axis=-1), image) for s in range(WIDTH)] for cell in cells])[slots]
    wanted[2] = 0.0
    np.testing.assert_allclose(found, wanted, atol=5e-3 * np.abs(wanted).max())  # bytes
    best = best_around(found)
    np.testing.assert_array_equal(best[:, 1], found[:, 3:8].max(axis=1))
    np.testing.assert_array_equal(best[:, 0], np.concatenate([found[:, :3], found[:, -2:]], axis=1).max(axis=1))
