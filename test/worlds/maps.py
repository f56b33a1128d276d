"""A stored map with every picture in memory."""

from dataclasses import replace

from sphere_nav.ros.maps.reader import MapReader
from sphere_nav.spheres.graph import SphereGraph


def load_all(reader: MapReader) -> SphereGraph:
    """Return the graph with the key spheres themselves."""
    nodes = [replace(node, sphere=reader.load_sphere(node.id)) for node in reader.graph]
    return SphereGraph(nodes, reader.graph.edges)
