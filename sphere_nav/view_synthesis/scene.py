"""The key spheres of a map, drawn from anywhere: the nearest ones are read as they are needed and kept for a while."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Protocol

import numpy as np

from sphere_nav.geometry import SE3, Camera
from sphere_nav.spheres.experiences import split_by_experience
from sphere_nav.spheres.graph import Experience, KeySphere, SphereGraph
from sphere_nav.spheres.sphere import Sphere
from sphere_nav.view_synthesis.constants import NUM_BLENDED
from sphere_nav.view_synthesis.surface import Surface, surface_of
from sphere_nav.view_synthesis.synthesis import PlacedSurface, SynthesizedView, blend_weights, synthesize


class SphereSource(Protocol):
    """A map on disk or in memory."""

    @property
    def graph(self) -> SphereGraph:
        """Where the key spheres are."""
        ...

    def load_sphere(self, sphere_id: int) -> Sphere:
        """Return one key sphere with its pictures; ValueError or OSError where it cannot be read."""
        ...


class Scene:
    """Draws views of a map; one thread prepares surfaces; kept are `max_megabytes`, for two views at least."""

    def __init__(self, source: SphereSource, max_megabytes: float = 500.0) -> None:
        if not len(source.graph):
            raise ValueError("view: expected a map with key spheres, found an empty one")
        self._source, self._max_bytes = source, max_megabytes * 1e6
        self._parts = split_by_experience(source.graph)
        self._pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="surfaces")
        self._surfaces: OrderedDict[int, Future[Surface]] = OrderedDict()  # by last use
        self._lock = threading.Lock()

    @property
    def experiences(self) -> tuple[Experience, ...]:
        """What the map can be seen in, in the order of its key spheres."""
        return tuple(self._parts)

    def render(
        self,
        T_map_camera: SE3,
        camera: Camera,
        experience: Experience | None = None,
        *,
        is_waiting: bool = True,
        count: int = NUM_BLENDED,
    ) -> SynthesizedView:
        """Return the view from a pose in one experience, or by the nearest key spheres of any.

        `count`: key spheres of which it is made; more of them fill holes and take longer.
        With `is_waiting` false by what is ready, others are prepared meanwhile. ValueError or OSError where a key
        sphere cannot be read.
        """
        graph = self._graph(experience)
        nodes = graph.nearest(T_map_camera.translation, count + 1)
        wanted = nodes[:count]
        coming = [self._request(node.id) for node in wanted]
        if not is_waiting and not any(one.done() for one in coming):
            wanted, coming = self._stand_in(T_map_camera, graph) or (wanted, coming)
        weights = self._weights(nodes, T_map_camera, count)
        placed = [
            PlacedSurface(one.result(), node.T_map_sphere, float(weight))
            for node, one, weight in zip(wanted, coming, weights, strict=False)
            if is_waiting or one.done()
        ]
        return synthesize(placed or [PlacedSurface(coming[0].result(), wanted[0].T_map_sphere)], T_map_camera, camera)

    def is_ready(self, T_map_camera: SE3, experience: Experience | None = None, count: int = NUM_BLENDED) -> bool:
        """Say whether the view from a pose needs nothing that is not prepared."""
        nodes = self._graph(experience).nearest(T_map_camera.translation, count)
        return all(self._request(node.id).done() for node in nodes)

    def close(self) -> None:
        """End what is being prepared."""
        self._pool.shutdown(wait=True, cancel_futures=True)

    def _graph(self, experience: Experience | None) -> SphereGraph:
        return self._source.graph if experience is None else self._parts[experience]

    def _weights(self, nodes: Sequence[KeySphere], T_map_camera: SE3, count: int) -> list[float]:
        distances = [float(np.linalg.norm(node.T_map_sphere.translation - T_map_camera.translation)) for node in nodes]
        if len(distances) <= count:
            distances.append(2.0 * max(distances))
        return list(blend_weights(distances))

    def _stand_in(self, T_map_camera: SE3, graph: SphereGraph) -> tuple[list[KeySphere], list[Future[Surface]]] | None:
        """Return the nearest key sphere that is ready."""
        with self._lock:
            ready = {number: one for number, one in self._surfaces.items() if one.done() and number in graph.nodes}
        nodes = [graph[sphere_id] for sphere_id in ready]
        if not nodes:
            return None
        nearest = min(nodes, key=lambda node: T_map_camera.distance(node.T_map_sphere)[0])
        return [nearest], [ready[nearest.id]]

    def _request(self, sphere_id: int) -> Future[Surface]:
        with self._lock:
            if sphere_id not in self._surfaces or _has_failed(self._surfaces[sphere_id]):
                self._surfaces[sphere_id] = self._pool.submit(self._prepare, sphere_id)
            self._surfaces.move_to_end(sphere_id)
            return self._surfaces[sphere_id]

    def _prepare(self, sphere_id: int) -> Surface:
        surface = surface_of(self._source.load_sphere(sphere_id))
        with self._lock:
            kept = surface.num_bytes
            for other, one in list(self._surfaces.items())[::-1]:
                if other == sphere_id or not one.done():
                    continue
                kept += 0 if _has_failed(one) else one.result().num_bytes
                if kept > self._max_bytes and len(self._surfaces) > 2 * NUM_BLENDED:
                    del self._surfaces[other]
        return surface


def _has_failed(one: Future[Surface]) -> bool:
    return one.done() and (one.cancelled() or one.exception() is not None)
