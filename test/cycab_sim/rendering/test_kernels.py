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


def lit_by(points, normals, reach=np.inf):
    num = len(points)
    some, rays = np.empty(num, np.int64), np.empty((num, 3), np.float32)
    distances, lux = np.empty(num, np.float32), np.empty(num, np.float32)
    lamp = np.zeros(3), np.array([1.0, 0.0, 0.0]), np.cos(np.radians([60.0, 30.0]))
    count = kernels.collect_lit(np.float32(points), np.float32(normals), lamp, reach, some, rays, distances, lux)
    return some[:count].tolist(), distances[:count], lux[:count]


def test_a_lamp_lights_what_looks_at_it_within_its_cone_and_reach():
    back = [[-1.0, 0.0, 0.0]] * 6
    points = [[2.0, 0, 0], [4.0, 0, 0], [-2.0, 0, 0], [1.0, 5.0, 0], [2.0, 0, 0], [30.0, 0, 0]]
    some, distances, lux = lit_by(points, [*back[:4], [1.0, 0, 0], back[0]], reach=20.0)
    assert some == [0, 1]  # not: behind it, outside the cone, facing away, too far
    np.testing.assert_allclose(distances, [2.0, 4.0])
    np.testing.assert_allclose(lux, [1 / 4, 1 / 16], rtol=1e-6)
