import numpy as np
import pytest

from sphere_mapping.graph.store import SphereCache
from sphere_mapping.mapper import Mapper
from sphere_mapping.params import KeySphereParams, MapperParams
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


def test_without_a_store_they_stay_in_the_graph():
    graph, spheres = graph_of(2)
    cache = SphereCache()
    cache.flush(graph)
    assert [cache.load(node) for node in graph] == spheres
    with pytest.raises(ValueError, match="key sphere 5: expected its picture in memory"):
        cache.load(KeySphere(5, 5, SE3.identity()))


@pytest.mark.slow
def test_a_mapper_with_a_store_makes_the_same_map_and_holds_no_pictures():
    room, params = sharp_room(), MapperParams(key=KeySphereParams(max_parallax_whole=0.05))
    steps = [*range(8), *range(6, -1, -1)]  # there and back, so that a loop is loaded from the store
    graphs = []
    for store in (None, Shelf()):
        mapper = Mapper(params, store=store)
        for number, step in enumerate(steps):
            sphere = room.sphere(SE3.from_planar(0.1 * step, 0, 0), Spherical(256, 128), number)
            object.__setattr__(sphere, "stamp_ns", number * 100_000_000)
            mapper.add(sphere)
        mapper.close_loops()
        graphs.append((mapper.graph, store))
    (in_memory, _), (stored, shelf) = graphs
    assert any(edge.is_loop for edge in stored.edges)
    assert [(e.a, e.b) for e in stored.edges] == [(e.a, e.b) for e in in_memory.edges]
    for a, b in zip(in_memory, stored, strict=True):
        np.testing.assert_array_equal(a.T_map_sphere.matrix, b.T_map_sphere.matrix)
        assert a.sphere is shelf.spheres[b.id] or np.array_equal(a.sphere.image, shelf.spheres[b.id].image)
        assert b.sphere is None
