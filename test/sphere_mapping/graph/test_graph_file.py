import numpy as np

from sphere_mapping.graph.graph_file import write_g2o
from sphere_nav.geometry import SE3
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph


def test_a_graph_is_written_as_others_read_it(tmp_path):
    rng = np.random.default_rng(5)
    motion, half = SE3.exp(rng.normal(size=6)), rng.normal(size=(6, 6))
    information = half @ half.T
    nodes = [KeySphere(3, 0, SE3.identity()), KeySphere(8, 1, motion)]
    write_g2o(tmp_path / "graph.g2o", SphereGraph(nodes, [Edge(3, 8, motion, information)]))
    *vertices, edge = [line.split() for line in (tmp_path / "graph.g2o").read_text().splitlines()]
    assert [line[:2] for line in vertices] == [["VERTEX_SE3:QUAT", "3"], ["VERTEX_SE3:QUAT", "8"]]
    assert edge[:3] == ["EDGE_SE3:QUAT", "3", "8"]
    numbers = np.array([float(value) for value in edge[3:]])
    np.testing.assert_allclose(numbers[7:], information[np.triu_indices(6)])
    found = SE3.from_quaternion(numbers[3:7], numbers[:3])  # x y z w, as g2o has it
    np.testing.assert_allclose(found.matrix, motion.matrix, atol=1e-9)
