"""After the warm-up the first image compiles nothing."""

import pytest

from photometric import kernels, warm_up


def test_every_kernel_of_the_registration_is_compiled_for_both_kinds_of_image():
    pytest.importorskip("numba")
    if not hasattr(kernels.linearise, "signatures"):
        pytest.skip("the JIT is off")
    warm_up()
    for kernel, kinds in ((kernels.linearise, 2), (kernels.halve, 2), (kernels.accumulate, 1)):
        assert len(kernel.signatures) >= kinds
