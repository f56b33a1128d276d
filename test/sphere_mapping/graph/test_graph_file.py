import numpy as np

from sphere_mapping.graph.graph_file import write_g2o
from sphere_nav.geometry import SE3
from worlds.cylinder import cylinder


def test_a_graph_is_written_as_others_read_it(tmp_path):
    _, graph = cylinder(2, 6, (0.1, 0.05))
    write_g2o(tmp_path / "graph.g2o", graph)
    lines = [line.split() for line in (tmp_path / "graph.g2o").read_text().splitlines()]
    vertices = [line for line in lines if line[0] == "VERTEX_SE3:QUAT"]
    edges = [line for line in lines if line[0] == "EDGE_SE3:QUAT"]
    assert len(vertices) == len(graph.ids)
    assert [[int(edge[1]), int(edge[2])] for edge in edges] == graph.ends.tolist()
    numbers = np.array([float(value) for value in edges[1][3:]])
    upper = graph.information[1][np.triu_indices(6)]
    np.testing.assert_allclose(numbers[-len(upper) :], upper)
    motion = SE3.from_quaternion(numbers[3:7], numbers[:3]).matrix  # x y z w, as g2o has it
    np.testing.assert_allclose(motion, graph.motions[1], atol=1e-9)
