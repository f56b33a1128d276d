import numpy as np
import pytest

from cycab_sim.rendering import kernels


def test_edges_are_where_surfaces_or_ranges_change_and_the_light_with_them():
    triangles = np.array([[0, 0, 1, 2], [0, 0, 1, 3], [-1, -1, kernels.OUTSIDE, 3]], np.int32)
    surface_of = np.array([0, 1, 1, 2], np.int32)
    normals = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0], [1, 0, 0]], np.float32)
    ranges = np.array([[5, 5, 6, 9], [5, 5, 6, 9], [np.inf, np.inf, np.nan, 9]], np.float32)
    levels = np.array([[1, 1, 2, 3], [1, 1, 2, 3.01], [9, 9, 0, 3]], np.float32)
    found = np.empty((3, 4), np.uint8)
    kernels.find_edges(triangles, surface_of, normals, ranges, np.repeat(levels[..., None], 3, 2), found)
    # between 2 and 3 on the right the surface changes but the light does not; OUTSIDE is no edge
    assert found.tolist() == [[0, 1, 1, 1], [1, 1, 1, 1], [1, 1, 0, 0]]


def test_a_shadow_is_drawn():
    shadow = np.full((40, 40), 9.0, np.float32)
    triangle = np.array([[[1.0, 1.0, 4.0], [3.0, 1.0, 4.0], [1.0, 3.0, 5.0]]], np.float32)
    kernels.cast_shadows(triangle, np.eye(3), np.zeros(2), 0.1, shadow)
    assert shadow[15, 15] == pytest.approx(4.25)  # row y, column x; the depth rises with y
    assert shadow[29, 29] == 9.0  # beyond the long side
    assert shadow[5, 15] == 9.0
    assert (shadow < 9.0).sum() == pytest.approx(200, rel=0.2)  # 2 m^2 in texels, and a fringe
