"""Kernels of depth panoramas against NumPy."""

import numpy as np

from mcl_depth.geometry import kernels


def test_lzf_that_points_before_its_beginning_is_refused():
    assert kernels.decompress_lzf(np.frombuffer(b"\x20\x7f", np.uint8), np.zeros(8, np.uint8)) == -1
