import numpy as np

from sphere_nav.geometry import SE3
from sphere_nav.ros.conversions.graphs import graph_to_markers
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph


def test_every_key_sphere_is_a_ball_and_every_edge_a_line_of_its_kind():
    nodes = [KeySphere(k, k, SE3.from_parts(np.eye(3), [float(k), 2.0, 0.5])) for k in range(3)]
    edges = [Edge(0, 1, SE3.identity(), np.eye(6)), Edge(1, 2, SE3.identity(), np.eye(6))]
    loop = Edge(0, 2, SE3.identity(), np.eye(6), is_loop=True)
    balls, lines, loops = graph_to_markers(SphereGraph(nodes, [*edges, loop]), 1_500_000_000, "map").markers
    assert [point.x for point in balls.points] == [0.0, 1.0, 2.0]
    assert [(point.x, point.y, point.z) for point in loops.points] == [(0.0, 2.0, 0.5), (2.0, 2.0, 0.5)]
    assert len(lines.points) == 4
    for marker in (balls, lines, loops):
        assert (marker.header.frame_id, marker.header.stamp.sec) == ("map", 1)
        assert marker.pose.orientation.w == 1.0
        assert marker.color.a > 0
        assert marker.scale.x > 0
    assert len({marker.ns for marker in (balls, lines, loops)}) == 3
