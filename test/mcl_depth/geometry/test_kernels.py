"""Kernels of depth panoramas against NumPy."""

import numpy as np

from mcl_depth.geometry import kernels


def test_lzf_that_points_before_its_beginning_is_refused():
    assert kernels.decompress_lzf(np.array([0x20, 0x7F], np.uint8), np.zeros(8, np.uint8)) == -1
