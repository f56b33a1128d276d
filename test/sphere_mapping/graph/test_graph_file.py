import numpy as np
import pytest

from sphere_mapping.graph.graph_file import write_g2o
from sphere_nav.geometry import SE3
from worlds.cylinder import cylinder


@pytest.mark.parametrize(("planar", "kind", "size"), [(True, "SE2", 3), (False, "SE3:QUAT", 6)])
def test_a_graph_is_written_as_others_read_it(tmp_path, planar, kind, size):
    _, graph = cylinder(2, 6, (0.1, 0.05), planar=planar)
    write_g2o(tmp_path / "graph.g2o", graph)
    lines = [line.split() for line in (tmp_path / "graph.g2o").read_text().splitlines()]
    vertices = [line for line in lines if line[0] == f"VERTEX_{kind}"]
    edges = [line for line in lines if line[0] == f"EDGE_{kind}"]
    assert len(vertices) == len(graph.ids)
    assert [[int(edge[1]), int(edge[2])] for edge in edges] == graph.ends.tolist()
    numbers = np.array([float(value) for value in edges[1][3:]])
    upper = graph.information[1][np.triu_indices(size)]
    np.testing.assert_allclose(numbers[-len(upper) :], upper)
    if planar:
        x, y, angle = numbers[:3]
        motion = np.array([[np.cos(angle), -np.sin(angle), x], [np.sin(angle), np.cos(angle), y], [0, 0, 1]])
    else:
        motion = SE3.from_quaternion(numbers[3:7], numbers[:3]).matrix  # x y z w, as g2o has it
    np.testing.assert_allclose(motion, graph.motions[1], atol=1e-9)
