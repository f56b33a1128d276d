import numpy as np

from cycab_sim.rendering import kernels


def test_edges_are_where_surfaces_or_ranges_change_and_the_light_with_them():
    triangles = np.array([[0, 0, 1, 2], [0, 0, 1, 3], [-1, -1, kernels.OUTSIDE, 3]], np.int32)
    surface_of = np.array([0, 1, 1, 2], np.int32)
    ranges = np.array([[5, 5, 6, 9], [5, 5, 6, 9], [np.inf, np.inf, np.nan, 9]], np.float32)
    levels = np.array([[1, 1, 2, 3], [1, 1, 2, 3.01], [9, 9, 0, 3]], np.float32)
    found = np.empty((3, 4), np.uint8)
    kernels.find_edges(triangles, surface_of, ranges, np.repeat(levels[..., None], 3, 2), found)
    # between 2 and 3 on the right the surface changes but the light does not; OUTSIDE is no edge
    assert found.tolist() == [[0, 1, 1, 1], [1, 1, 1, 1], [1, 1, 0, 0]]
