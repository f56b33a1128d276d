"""Where the spheres of a graph are: in its nodes, or written away as they are kept, so that memory stays small."""

from __future__ import annotations

from typing import Protocol

from sphere_nav.spheres.graph import KeySphere, SphereGraph
from sphere_nav.spheres.sphere import Sphere


class SphereStore(Protocol):
    """Takes key spheres in order of their ids and gives them back."""

    def add(self, node: KeySphere, sphere: Sphere) -> None:
        """Keep a key sphere."""
        ...

    def tell(self, graph: SphereGraph) -> None:
        """Take note of the graph as it is now, whose newest key spheres are added next."""
        ...

    def load(self, sphere_id: int) -> Sphere:
        """Return a key sphere that was added; ValueError or OSError where it cannot be read."""
        ...


class SphereCache:
    """The spheres of one growing graph; without a store they stay in its nodes."""

    def __init__(self, store: SphereStore | None = None) -> None:
        self._store = store

    def flush(self, graph: SphereGraph) -> None:
        """Hand over what is not stored yet, and forget it."""
        if self._store is None:
            return
        new = [node for node in graph if node.sphere is not None]
        if new:
            self._store.tell(graph)
        for node in new:
            assert node.sphere is not None
            self._store.add(node, node.sphere)
            graph.forget_sphere(node.id)

    def load(self, node: KeySphere) -> Sphere:
        """Return the sphere of a node; ValueError where nobody has it."""
        if node.sphere is not None:
            return node.sphere
        if self._store is None:
            raise ValueError(f"key sphere {node.id}: expected its picture in memory, found none")
        return self._store.load(node.id)
