"""The key spheres that an image is aligned to: chosen by distance alone (M15 eq. 17), prepared once, kept for a while.

A whole sphere sees in every direction, so translation is all that counts. A partial sphere (one camera's view) may
look elsewhere; it is passed over where it covers clearly less of the image than others do.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dense_localizer.params import LocalizerParams
from photometric import Pyramid, Reference, View, prepare_reference
from photometric.overlap import image_overlap
from sphere_geometry import SE3, Spherical
from sphere_mapping.graph import KeySphere, SphereGraph
from sphere_mapping.sphere import Sphere

NUM_DIGEST_LEVELS = 2  # the coarsest levels are kept of every sphere: for choosing and for the start


class SphereMap(Protocol):
    """A map on disk or in memory."""

    @property
    def graph(self) -> SphereGraph:
        """Where the key spheres are."""
        ...

    def load_sphere(self, sphere_id: int) -> Sphere:
        """Return one key sphere with its pictures; ValueError or OSError where it cannot be read."""
        ...


@dataclass(frozen=True)
class Digest:
    """What is kept of every sphere: its coarsest levels, its window and its median range in metres."""

    reference: Reference
    camera: Spherical
    typical_range_m: float


@dataclass(frozen=True)
class Choice:
    """The references of one image. distance_ratio: distance to the nearest by its median range."""

    ids: tuple[int, ...]
    views: tuple[View, ...]
    overlap: float  # of the best covering one, 0..1
    distance_ratio: float


class References:
    """Prepared key spheres of one map."""

    def __init__(self, sphere_map: SphereMap, params: LocalizerParams) -> None:
        self._map = sphere_map
        self._registration = params.registration
        self._params = params.reference
        self._prepared: OrderedDict[int, Reference] = OrderedDict()
        self._digests: dict[int, Digest] = {}

    @property
    def nodes(self) -> Iterator[KeySphere]:
        """All key spheres in the order of the graph."""
        return iter(self._map.graph)

    def nearest(self, point_map: NDArray[np.float64], count: int) -> list[KeySphere]:
        """Return the key spheres nearest to a point in the map, nearest first (M15 eq. 17)."""
        return self._map.graph.nearest(point_map, count)

    def choose(self, T_map_camera: SE3, pyramid: Pyramid) -> Choice:
        """Return the references for an image taken near a pose."""
        candidates = self.nearest(T_map_camera.translation, self._params.num_candidates)
        overlaps = [self.overlap(node, T_map_camera, pyramid) for node in candidates]
        needed = max(self._params.min_visible_share, self._params.relative_share * max(overlaps, default=0.0))
        chosen = [node for node, overlap in zip(candidates, overlaps, strict=True) if overlap >= needed]
        chosen = chosen[: self._params.num_references]
        views = tuple(View(self.prepared(node.id), node.T_map_sphere) for node in chosen)
        ratio = self._distance_ratio(chosen[0], T_map_camera) if chosen else np.inf
        return Choice(tuple(node.id for node in chosen), views, max(overlaps, default=0.0), ratio)

    def overlap(self, node: KeySphere, T_map_camera: SE3, pyramid: Pyramid) -> float:
        """Return the share of the image that a key sphere covers."""
        return image_overlap(pyramid, [View(self.digest(node.id).reference, node.T_map_sphere)], T_map_camera)

    def prepared(self, sphere_id: int) -> Reference:
        """Return a reference with all levels, prepared now or before."""
        if sphere_id not in self._prepared:
            self._prepare(sphere_id)
        self._prepared.move_to_end(sphere_id)
        return self._prepared[sphere_id]

    def digest(self, sphere_id: int) -> Digest:
        """Return the small part of a sphere that is kept for good."""
        if sphere_id not in self._digests:
            self._prepare(sphere_id)
        return self._digests[sphere_id]

    def _prepare(self, sphere_id: int) -> None:
        sphere = self._map.load_sphere(sphere_id)
        reference = prepare_reference(sphere.grey, sphere.range_m, sphere.camera, self._registration)
        self._prepared[sphere_id] = reference
        while len(self._prepared) > self._params.cache_size:
            self._prepared.popitem(last=False)
        finite = sphere.range_m[::8, ::8]
        finite = finite[np.isfinite(finite)]
        typical = float(np.median(finite)) if finite.size else np.inf
        self._digests[sphere_id] = Digest(Reference(reference.levels[-NUM_DIGEST_LEVELS:]), sphere.camera, typical)

    def _distance_ratio(self, node: KeySphere, T_map_camera: SE3) -> float:
        distance, _ = node.T_map_sphere.distance(T_map_camera)
        return float(distance) / self.digest(node.id).typical_range_m
