"""The key-sphere graph as a message and back."""

import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.ros.conversions import graph_to_message, message_to_graph
from sphere_nav.ros.conversions.graphs import graph_to_markers
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph


def test_the_region_of_a_key_sphere_comes_back_and_must_be_meters():
    graph = SphereGraph([KeySphere(1, 0, SE3.identity(), region_radius_m=7.5), KeySphere(2, 0, SE3.identity())])
    message = graph_to_message(graph, "map")
    assert [node.region_radius_m for node in message_to_graph(message)] == [7.5, 0.0]
    for wrong in (-1.0, float("nan"), float("inf")):
        message.vertices[0].region_radius = wrong
        with pytest.raises(ValueError, match="vertex 1 region_radius"):
            message_to_graph(message)


def test_an_edge_between_turned_spheres_is_sure_along_the_right_axis_and_finite_without_information():
    """A turn by 90 degrees makes what is certain along x of the second sphere certain along y of the first."""
    T_a_b = SE3.from_planar(1.0, 0.0, np.pi / 2)
    information = np.diag([1e4, 1.0, 1.0, 1.0, 1.0, 1.0])
    graph = SphereGraph([KeySphere(1, 0, SE3.identity()), KeySphere(2, 0, T_a_b)], [Edge(1, 2, T_a_b, information)])
    covariance = np.reshape(graph_to_message(graph, "map").edges[0].pose.covariance, (6, 6))
    np.testing.assert_allclose(np.diag(covariance), [1.0, 1e-4, 1.0, 1.0, 1.0, 1.0], rtol=1e-6)
    information = np.diag([1.0, 1.0, 1.0, 1.0, 1.0, 0.0])
    T_a_b = SE3.identity()
    graph = SphereGraph([KeySphere(1, 0, T_a_b), KeySphere(2, 0, T_a_b)], [Edge(1, 2, T_a_b, information)])
    message = graph_to_message(graph, "map")
    covariance = np.reshape(message.edges[0].pose.covariance, (6, 6))
    np.testing.assert_allclose(covariance, np.diag([1.0, 1.0, 1.0, 1.0, 1.0, 1e12]), rtol=1e-9)
    np.testing.assert_allclose(message_to_graph(message).edges[0].information, information, atol=1e-9)


def test_what_is_no_graph_is_refused(sphere_graph):
    for change, reason in [
        (lambda m: setattr(m.vertices[1], "id", 10), "expected a new id, found 10 again"),
        (lambda m: setattr(m.edges[1], "to_id", 99), "edge 11-99: expected both ends"),
        (lambda m: setattr(m.vertices[0].pose.position, "x", np.nan), r"vertex 10 pose\.position: expected finite"),
        (lambda m: setattr(m.edges[0].pose, "covariance", [np.nan] * 36), "edge 10-11: covariance: expected finite"),
    ]:
        message = graph_to_message(sphere_graph, "map")
        change(message)
        with pytest.raises(ValueError, match=reason):
            message_to_graph(message)


def test_the_head_has_the_stamp_of_the_newest_and_vertices_come_by_id():
    nodes = [KeySphere(k, ns, SE3.identity()) for k, ns in ((5, 7_000_000_000), (2, 9_000_000_000), (8, 1_000_000_000))]
    message = graph_to_message(SphereGraph(nodes), "map")
    assert (message.header.stamp.sec, [vertex.id for vertex in message.vertices]) == (9, [2, 5, 8])
    assert graph_to_message(SphereGraph(), "map").header.stamp.sec == 0


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
