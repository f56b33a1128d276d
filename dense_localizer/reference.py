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

from dense_localizer.coverage import coverage
from dense_localizer.params import LocalizerParams
from photometric import Reference, View, prepare_reference
from photometric.reference import ReferenceLevel
from sphere_geometry import SE3, Camera, Spherical
from sphere_map.graph import KeySphere, SphereGraph
from sphere_map.sphere import Sphere

NUM_DIGEST_LEVELS = 2  # the coarsest levels are kept of every sphere: for choosing and for the start
MIN_KEPT = 10_000  # levels that would keep fewer pixels keep all
NUM_DIGEST_POINTS = 150  # about as many points of the coarsest level tell what a partial sphere covers
RANGE_STEP = 8  # every eighth row and column are enough for the median range


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
    """What is kept of every sphere: its coarsest levels, a few points (N, 3) m, its window, its median range in m."""

    reference: Reference
    points: NDArray[np.float32]
    camera: Spherical
    typical_range_m: float


@dataclass(frozen=True)
class Choice:
    """The references of one image; range and distance are those of the nearest."""

    ids: tuple[int, ...]
    views: tuple[View, ...]
    overlap: float  # of the best covering one, 0..1
    distance_m: float
    typical_range_m: float

    @property
    def distance_ratio(self) -> float:
        """Distance to the nearest by its median range: 0 at its centre, 1 as far away as what it sees."""
        return self.distance_m / self.typical_range_m


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

    def nearest(self, point_map: NDArray[np.float64], count: int, max_distance_m: float = np.inf) -> list[KeySphere]:
        """Return the key spheres nearest to a point in the map, nearest first (M15 eq. 17)."""
        return self._map.graph.nearest(point_map, count, max_distance_m)

    def choose(self, T_map_camera: SE3, camera: Camera) -> Choice:
        """Return the references for an image taken near a pose: the nearest of those that cover it."""
        candidates, overlaps = self._candidates(T_map_camera, camera)
        best = float(np.max(overlaps, initial=0.0))
        needed = max(self._params.min_visible_share, self._params.relative_share * best)
        usable = [candidates[index] for index in np.flatnonzero(overlaps >= needed)[: self._params.num_references]]
        chosen = usable[:1] + [node for node in usable[1:] if self._is_within_reach(node, T_map_camera)]
        if not chosen:
            return Choice((), (), best, np.inf, np.inf)
        views = tuple(View(self.prepared(node.id), node.T_map_sphere) for node in chosen)
        distance, typical = distance_of(chosen[0], T_map_camera), self.digest(chosen[0].id).typical_range_m
        return Choice(tuple(node.id for node in chosen), views, best, distance, typical)

    def prepared(self, sphere_id: int) -> Reference:
        """Return a reference with the salient pixels of all levels, prepared now or before."""
        if sphere_id not in self._prepared:
            reference = self._load(sphere_id)
            levels = (salient(level, self._params.kept_share) for level in reference.levels)
            self._prepared[sphere_id] = Reference(tuple(levels))
            if len(self._prepared) > self._params.cache_size:
                self._prepared.popitem(last=False)
        self._prepared.move_to_end(sphere_id)
        return self._prepared[sphere_id]

    def digest(self, sphere_id: int) -> Digest:
        """Return the small part of a sphere that is kept for good."""
        if sphere_id not in self._digests:
            self._load(sphere_id)
        return self._digests[sphere_id]

    def _candidates(self, T_map_camera: SE3, camera: Camera) -> tuple[list[KeySphere], NDArray[np.float64]]:
        """Return the nearest key spheres and the share of the image that each covers, 1 for whole spheres."""
        nodes = self.nearest(T_map_camera.translation, self._params.num_candidates)
        first = nodes[: self._params.num_references]
        if all(self.digest(node.id).camera.is_whole for node in first):
            return first, np.ones(len(first))
        digests = [self.digest(node.id) for node in nodes]
        T_camera_map = T_map_camera.inverse()
        T_camera_sphere = [T_camera_map @ node.T_map_sphere for node in nodes]
        overlaps = coverage([digest.points for digest in digests], T_camera_sphere, camera)
        return nodes, np.where([digest.camera.is_whole for digest in digests], 1.0, overlaps)

    def _is_within_reach(self, node: KeySphere, T_map_camera: SE3) -> bool:
        """Say whether a key sphere is near enough to be used beside a nearer one."""
        return distance_of(node, T_map_camera) <= self._params.reach * self.digest(node.id).typical_range_m

    def _load(self, sphere_id: int) -> Reference:
        """Read and prepare a sphere; its digest is kept."""
        sphere = self._map.load_sphere(sphere_id)
        reference = prepare_reference(sphere.grey, sphere.range_m, sphere.camera, self._registration)
        if sphere_id not in self._digests:
            self._digests[sphere_id] = digest_of(sphere, reference)
        return reference


def read_all(sphere_map: SphereMap, params: LocalizerParams) -> References:
    """Return the references of a map whose spheres have all been looked at, so that no image has to wait for that."""
    references = References(sphere_map, params)
    for node in references.nodes:
        references.digest(node.id)
    return references


def distance_of(node: KeySphere, T_map_camera: SE3) -> float:
    """Return the metres between a key sphere and a camera."""
    return float(np.linalg.norm(node.T_map_sphere.translation - T_map_camera.translation))


def digest_of(sphere: Sphere, reference: Reference) -> Digest:
    """Return what is kept of a sphere."""
    ranges = sphere.range_m[::RANGE_STEP, ::RANGE_STEP]
    ranges = ranges[np.isfinite(ranges)]
    typical = float(np.median(ranges)) if ranges.size else np.inf
    coarse = Reference(reference.levels[-NUM_DIGEST_LEVELS:])
    points = coarse.levels[-1].points
    points = np.ascontiguousarray(points[:, :: max(1, points.shape[1] // NUM_DIGEST_POINTS)].T)
    return Digest(coarse, points, sphere.camera, typical)


def salient(level: ReferenceLevel, share: float) -> ReferenceLevel:
    """Return a level reduced to its more salient pixels (M15 section 3.6), so that choosing among them is quick."""
    number = int(share * level.num_pixels)
    return level.take(np.flatnonzero(level.rank < number)) if number >= MIN_KEPT else level
