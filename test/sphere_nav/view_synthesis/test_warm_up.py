"""Compiled before the first view."""

from sphere_nav.view_synthesis import kernels
from sphere_nav.view_synthesis.warm_up import warm_up


def test_every_kernel_is_compiled():
    warm_up()
    drawing = ("find_breaks", "cut_quads", "number_corners", "project_corners", "draw_quads")
    names = (*drawing, "add_colors", "divide_by_weights")
    found = [getattr(kernels, name) for name in names]
    assert all(kernel.signatures for kernel in found if hasattr(kernel, "signatures"))
