"""Compiled before the first view."""

from sphere_nav.view_synthesis import kernels
from sphere_nav.view_synthesis.warm_up import warm_up


def test_every_kernel_is_compiled():
    warm_up()
    assert all(kernel.signatures for kernel in (kernels.project_corners, kernels.draw_quads))
