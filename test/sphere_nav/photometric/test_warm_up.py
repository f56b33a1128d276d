"""After the warm-up the first image compiles nothing."""

import pytest

from sphere_nav.photometric import warm_up
from sphere_nav.photometric.align.descent import kernels as descent
from sphere_nav.photometric.parts.kernels import score_shifts
from sphere_nav.photometric.pixels import kernels


def test_every_kernel_of_the_registration_is_compiled_once_for_both_kinds_of_image():
    if not hasattr(descent.descend, "signatures"):
        pytest.skip("the JIT is off")
    warm_up()
    for kernel in (descent.examine, kernels.find_visible):
        assert len(kernel.signatures) == 1
    assert kernels.best_of.signatures
    assert len(descent.descend.signatures) == 2  # few views, and those of a rig
    assert len(kernels.halve.signatures) == 3  # of bytes, floats and a reference
    assert len(score_shifts.signatures) == 2  # the image as it is, or with what no camera has seen
