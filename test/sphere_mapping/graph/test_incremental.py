import numpy as np

from sphere_mapping.graph import incremental
from sphere_mapping.graph.incremental import IncrementalOptimum
from sphere_mapping.graph.optimum import optimize_map
from sphere_nav.geometry import SE3
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph

LAP, NUM_LAPS, FIRST_ID = 20, 3, 7
STEP = SE3.from_planar(1.0, 0.0, 2 * np.pi / LAP)
SIGMA = np.repeat([0.02, 0.005], 3)
INFORMATION = np.diag(1 / SIGMA**2)


def measure(rng, T, is_loop=False, ends=(0, 0)):
    return Edge(*ends, T @ SE3.exp(SIGMA * rng.normal(size=6)), INFORMATION, is_loop)


def test_a_graph_that_grows_is_at_the_optimum_of_the_whole(rng, monkeypatch):
    monkeypatch.setattr(incremental, "LARGE", 30)
    graph, optimum, num_loops = SphereGraph([KeySphere(FIRST_ID, 0, SE3.identity())]), IncrementalOptimum(), 0
    for k in range(1, LAP * NUM_LAPS):
        node_id = FIRST_ID + k
        edge = measure(rng, STEP, ends=(node_id - 1, node_id))
        graph.add(KeySphere(node_id, k, graph[node_id - 1].T_map_sphere @ edge.T_a_b))
        graph.connect(edge)
        if k >= LAP and k % 4 == 0:
            drifted, loop = graph, measure(rng, SE3.identity(), True, (node_id - LAP, node_id))
            graph = optimum.with_loop(graph, loop)
            whole, num_loops = optimize_map(drifted.with_edges([loop])), num_loops + 1
            apart = [float(node.T_map_sphere.distance(whole[node.id].T_map_sphere)[0]) for node in graph]
            assert max(apart) < 0.004  # m; one edge errs by 20 mm
            assert [(e.a, e.b) for e in graph.edges] == [(e.a, e.b) for e in whole.edges]
    assert num_loops == sum(edge.is_loop for edge in graph.edges) == 10
    np.testing.assert_allclose(graph[FIRST_ID].T_map_sphere.matrix, np.eye(4), atol=1e-6)
