"""Kernels of depth panoramas against NumPy."""

import numpy as np

from mcl_depth.geometry import kernels


def test_the_arctangent_is_numpys_to_float32_rounding():
    angles = np.linspace(-np.pi, np.pi, 5001)
    y, x = np.sin(angles).astype(np.float32), np.cos(angles).astype(np.float32)
    ours = np.array([kernels.arctangent2(a, b) for a, b in zip(y, x, strict=True)])
    np.testing.assert_allclose(ours, np.arctan2(y, x), atol=3e-7)


def test_lzf_that_points_before_its_beginning_is_refused():
    assert kernels.decompress_lzf(np.array([0x20, 0x7F], np.uint8), np.zeros(8, np.uint8)) == -1
