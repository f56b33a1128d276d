import numpy as np

from sphere_mapping.graph.store import SphereCache
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph
from worlds.room import sharp_room

CAMERA = Spherical(128, 64)


class Shelf:
    """A store in memory that takes note of all that it is told."""

    def __init__(self):
        self.spheres, self.told = {}, []

    def add(self, node, sphere):
        self.spheres[node.id] = sphere

    def tell(self, graph):
        self.told.append(len(graph))

    def load(self, sphere_id):
        return self.spheres[sphere_id]


def graph_of(number):
    spheres = [sharp_room(seed=k).sphere(SE3.identity(), CAMERA) for k in range(number)]
    nodes = [KeySphere(k, k, SE3.identity(), sphere) for k, sphere in enumerate(spheres)]
    return SphereGraph(nodes, [Edge(k, k + 1, SE3.identity(), np.eye(6)) for k in range(number - 1)]), spheres


def test_pictures_leave_memory_for_the_store_once():
    graph, spheres = graph_of(3)
    shelf = Shelf()
    cache = SphereCache(shelf)
    cache.flush(graph)
    cache.flush(graph)
    assert all(node.sphere is None for node in graph)
    assert [cache.load(node) for node in graph] == spheres
    assert shelf.told == [3]  # before they are added
