import numpy as np

from sphere_mapping.graph.pose_graph import from_spheres, to_spheres
from sphere_nav.geometry import SE3
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph


def test_a_map_becomes_arrays_by_rows_and_poses_go_back_by_id():
    graph = SphereGraph([KeySphere(7, 1, SE3.identity()), KeySphere(3, 2, SE3.exp([1, 0, 0, 0, 0, 0.2]))])
    graph.connect(Edge(7, 3, SE3.exp([1, 0, 0, 0, 0, 0.1]), np.diag([4.0, 4, 4, 25, 25, 25]), is_loop=True))
    found = from_spheres(graph)
    np.testing.assert_array_equal(found.ids, [7, 3])
    np.testing.assert_array_equal(found.ends, [[0, 1]])
    np.testing.assert_array_equal(found.is_robust, [True])
    kappa, tau = found.precisions
    np.testing.assert_allclose([kappa[0], tau[0]], [12.5, 4.0])  # of isotropic information: half, and the whole
    moved = to_spheres(graph, found.poses[::-1])
    np.testing.assert_allclose(moved[7].T_map_sphere.matrix, graph[3].T_map_sphere.matrix)
