"""The key-sphere graph as visualization_msgs/MarkerArray, for RViz and Foxglove."""

from __future__ import annotations

from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from sphere_nav.geometry import SE3
from sphere_nav.ros.conversions.stamps import header
from sphere_nav.spheres.graph import Edge, SphereGraph

BLUE = ColorRGBA(r=0.1, g=0.4, b=0.9, a=0.9)
GREY = ColorRGBA(r=0.6, g=0.6, b=0.6, a=0.9)
ORANGE = ColorRGBA(r=1.0, g=0.5, b=0.0, a=0.9)
LINE_PER_SIZE = 0.15  # width of a line by the diameter of a sphere


def graph_to_markers(graph: SphereGraph, stamp: int, frame_id: str, size: float = 0.2) -> MarkerArray:
    """Return key spheres as balls of `size` metres, odometry edges as grey lines, loops as orange ones."""
    balls = _marker("key_spheres", Marker.SPHERE_LIST, stamp, frame_id, BLUE)
    balls.scale.x = balls.scale.y = balls.scale.z = size
    balls.points = [_point(node.T_map_sphere) for node in graph]
    lines = []
    for name, colour, is_loop in (("edges", GREY, False), ("loops", ORANGE, True)):
        line = _marker(name, Marker.LINE_LIST, stamp, frame_id, colour)
        line.scale.x = LINE_PER_SIZE * size
        line.points = [point for edge in graph.edges if edge.is_loop == is_loop for point in _ends(graph, edge)]
        lines.append(line)
    return MarkerArray(markers=[balls, *lines])


def _marker(name: str, kind: int, stamp: int, frame_id: str, colour: ColorRGBA) -> Marker:
    marker = Marker(header=header(stamp, frame_id), ns=name, id=0, type=kind, action=Marker.ADD, color=colour)
    marker.pose.orientation.w = 1.0
    return marker


def _ends(graph: SphereGraph, edge: Edge) -> tuple[Point, Point]:
    return _point(graph[edge.a].T_map_sphere), _point(graph[edge.b].T_map_sphere)


def _point(T_map_sphere: SE3) -> Point:
    x, y, z = (float(value) for value in T_map_sphere.translation)
    return Point(x=x, y=y, z=z)
