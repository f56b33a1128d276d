"""sphere_nav_msgs/KeySphereGraph against the graph of key spheres.

An edge's information (6, 6) is that of xi in T_a_b @ exp(xi), axes of b; the message carries its inverse about the
fixed axes of a, as ROS has it.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from sphere_nav_msgs.msg import KeySphereEdge, KeySphereGraph, KeySphereVertex, MapExperience, MapInfo
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.files.untrusted import short, told_at
from sphere_nav.ros.conversions.beliefs import make_marker
from sphere_nav.ros.conversions.headers import header, ns_to_time, time_to_ns
from sphere_nav.ros.conversions.poses import and_covariance, pose_to_se3, se3_to_pose, with_covariance
from sphere_nav.ros.conversions.status import told
from sphere_nav.spheres.experiences import split_by_experience
from sphere_nav.spheres.graph import Edge, Experience, KeySphere, SphereGraph

MARKER_SIZE = 0.2  # m
MAX_VARIANCE = 1e12  # of a direction that the edge says nothing about
COLORS = {
    "key_spheres": ColorRGBA(r=0.1, g=0.4, b=0.9, a=0.9),
    "edges": ColorRGBA(r=0.6, g=0.6, b=0.6, a=0.9),
    "loops": ColorRGBA(r=1.0, g=0.5, b=0.0, a=0.9),
}


def graph_to_message(
    graph: SphereGraph, frame_id: str, *, map_id: str = "", version: int = 1, software: str = ""
) -> KeySphereGraph:
    """Return the message: poses and edges, no pictures."""
    newest = max((node.stamp_ns for node in graph), default=0)
    return KeySphereGraph(
        header=header(newest, frame_id),
        map_id=map_id,
        version=version,
        format_version=MapInfo.FORMAT_VERSION,
        software=software,
        vertices=[_vertex(node) for node in sorted(graph, key=lambda node: node.id)],
        edges=[_edge(edge) for edge in graph.edges],
    )


def message_to_graph(message: KeySphereGraph) -> SphereGraph:
    """Return the graph, its key spheres without pictures; ValueError for a repeated id, an edge to nowhere, a NaN."""
    return SphereGraph(map(_from_vertex, message.vertices), [_from_edge(edge) for edge in message.edges])


def experiences_to_messages(graph: SphereGraph, frame_id: str) -> list[MapExperience]:
    """Return a message for each experience of the key spheres."""
    messages = []
    for one, part in split_by_experience(graph).items():
        nodes = sorted(part, key=lambda node: node.id)
        message = told(MapExperience(header=header(one.stamp_ns, frame_id)), one)
        message.ids, message.served = [node.id for node in nodes], [node.served for node in nodes]
        message.last_served = [ns_to_time(node.last_served_ns) for node in nodes]
        messages.append(message)
    return messages


def message_to_experience(message: MapExperience) -> Experience:
    """Return what its key spheres have in common."""
    return Experience(message.name, message.camera, message.drive, time_to_ns(message.header.stamp))


def messages_to_experiences(graph: SphereGraph, messages: Iterable[MapExperience]) -> SphereGraph:
    """Return the graph with what messages say of its key spheres, of an experience the last one.

    ValueError unless each is of one of them at most.
    """
    changes: dict[int, dict[str, Any]] = {}
    for one, message in {message_to_experience(message): message for message in messages}.items():
        if not len(message.ids) == len(message.served) == len(message.last_served):
            found = f"{len(message.ids)}, {len(message.served)}, {len(message.last_served)}"
            raise ValueError(f"experience {short(str(one))}: expected as many ids, served, last_served, found {found}")
        for node_id, served, last in zip(message.ids, message.served, message.last_served, strict=True):
            if int(node_id) not in graph.nodes or int(node_id) in changes or not 0.0 <= served < np.inf:
                expected = "key spheres of the graph, each once, and finite numbers of images"
                raise ValueError(f"experience {short(str(one))}: expected {expected}, found {node_id}, {served}")
            change = {"experience": one, "served": float(served), "last_served_ns": time_to_ns(last)}
            changes[int(node_id)] = change
    return graph.with_nodes(changes)


def _vertex(node: KeySphere) -> KeySphereVertex:
    pose = se3_to_pose(node.T_map_sphere)
    return KeySphereVertex(id=node.id, stamp=ns_to_time(node.stamp_ns), pose=pose, region_radius=node.region_radius_m)


def _from_vertex(vertex: KeySphereVertex) -> KeySphere:
    name, radius = f"vertex {vertex.id}", float(vertex.region_radius)
    if not 0.0 <= radius < np.inf:
        raise ValueError(f"{name} region_radius: expected metres, or 0 for not known, found {radius}")
    pose = pose_to_se3(vertex.pose, f"{name} pose")
    return KeySphere(int(vertex.id), time_to_ns(vertex.stamp), pose, region_radius_m=radius)


def _edge(edge: Edge) -> KeySphereEdge:
    kind = KeySphereEdge.LOOP if edge.is_loop else KeySphereEdge.ODOMETRY
    pose = with_covariance(edge.T_a_b, _inverse(edge.information))
    return KeySphereEdge(from_id=edge.a, to_id=edge.b, kind=kind, pose=pose)


def _from_edge(message: KeySphereEdge) -> Edge:
    with told_at(f"edge {message.from_id}-{message.to_id}"):
        T_a_b, covariance = and_covariance(message.pose)
    is_loop = message.kind == KeySphereEdge.LOOP
    return Edge(int(message.from_id), int(message.to_id), T_a_b, _inverse(covariance), is_loop)


def _inverse(matrix: Array) -> Array:
    """Invert a symmetric positive semi-definite (6, 6), directions without information becoming `MAX_VARIANCE`."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return (vectors / np.maximum(values, 1.0 / MAX_VARIANCE)) @ vectors.T


def graph_to_markers(graph: SphereGraph, stamp: int, frame_id: str) -> MarkerArray:
    """Return key spheres as balls, odometry edges as grey lines, loops as orange ones."""
    head, marks = header(stamp, frame_id), []
    size = MARKER_SIZE, MARKER_SIZE, MARKER_SIZE
    balls = make_marker(head, "key_spheres", Marker.SPHERE_LIST, COLORS["key_spheres"], size, SE3.identity())
    points = {node.id: se3_to_pose(node.T_map_sphere).position for node in graph}
    balls.points = list(points.values())
    for name, is_loop in (("edges", False), ("loops", True)):
        width = 0.15 * MARKER_SIZE, 0.0, 0.0
        line = make_marker(head, name, Marker.LINE_LIST, COLORS[name], width, SE3.identity())
        edges = [edge for edge in graph.edges if edge.is_loop == is_loop]
        line.points = [points[end] for edge in edges for end in (edge.a, edge.b)]
        marks.append(line)
    return MarkerArray(markers=[balls, *marks])
