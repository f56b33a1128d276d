"""The key spheres that an image is aligned to: chosen by distance alone (M15 eq. 17), prepared once, kept for a while.

A whole sphere sees in every direction, so translation is all that counts. A partial sphere (one camera's view) may
look elsewhere; it is passed over where it covers clearly less of the image than others do.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dense_localizer.coverage import coverage
from dense_localizer.map_error import MapError
from dense_localizer.params import LocalizerParams
from dense_localizer.preparation import Preparation
from dense_localizer.recognition import NUM_ALIKE
from dense_localizer.rejections import Rejections
from photometric import Reference, RegistrationParams, View, prepare_reference
from photometric.reference import ReferenceLevel, check_range
from sphere_geometry import SE3, Camera, Spherical
from sphere_map.appearance.index import AppearanceIndex
from sphere_map.graph import KeySphere, SphereGraph
from sphere_map.sphere import Sphere

NUM_CANDIDATES = 12  # nearest key spheres looked at
MIN_VISIBLE_SHARE = 0.25  # of the image, that a reference must cover
RELATIVE_SHARE = 0.6  # the same, of what the best candidate covers
UNKNOWN_REACH = 1.0  # region of a key sphere by its median range, where a map does not tell it
KEPT_SHARE = 0.25  # of a key sphere's pixels, the most salient
NUM_COARSE_LEVELS = 2  # are kept of every sphere: for choosing and for the start
MIN_KEPT = 10_000  # levels that would keep fewer pixels keep all
NUM_POINTS = 150  # about as many points of the coarsest level tell what a partial sphere covers
NUM_AHEAD = 4  # key spheres prepared around where the camera will be
AHEAD_S = 1.0  # s, when it will be there
AHEAD_STEP_M = 0.2  # motion after which one looks ahead anew


Residuals = tuple[View, NDArray[np.float64], NDArray[np.float64]]  # view, points (N, 3) in its axes, residuals (N,)


class SphereMap(Protocol):
    """A map on disk or in memory."""

    @property
    def graph(self) -> SphereGraph:
        """Where the key spheres are."""
        ...

    def load_sphere(self, sphere_id: int) -> Sphere:
        """Return one key sphere with its pictures; ValueError or OSError where it cannot be read."""
        ...

    def coarse_spheres(self) -> Mapping[int, Sphere]:
        """Return all key spheres small (`sphere_map.coarse`); ValueError or OSError where they cannot be read."""
        ...

    def appearance(self) -> AppearanceIndex:
        """Return what the key spheres look like, empty where that is not known; ValueError or OSError for damage."""
        ...


@dataclass(frozen=True)
class CoarseReference:
    """What is kept of every sphere: coarse levels, a few points (N, 3) m, its window, its median range in m."""

    reference: Reference
    points: NDArray[np.float32]
    camera: Spherical
    typical_range_m: float


class CoarseReferences(dict[int, CoarseReference]):
    """Small key spheres by id, each prepared when it is first asked for: a start in a large map asks for few.

    ValueError for a sphere whose ranges are zero or negative, at once.
    """

    def __init__(self, spheres: Mapping[int, Sphere], params: RegistrationParams) -> None:
        super().__init__()
        for sphere in spheres.values():
            check_range(sphere.range_m, sphere.camera)
        self._spheres, self._params = spheres, params

    def __missing__(self, sphere_id: int) -> CoarseReference:
        made = self[sphere_id] = coarse_reference(self._spheres[sphere_id], self._params)
        return made


@dataclass(frozen=True)
class Choice:
    """The references of one image; range, region and distance are those of the nearest."""

    ids: tuple[int, ...]
    views: tuple[View, ...]
    overlap: float  # of the best covering one, 0..1
    distance_m: float
    typical_range_m: float
    region_m: float

    @property
    def distance_ratio(self) -> float:
        """Distance to the nearest by the radius of its region: 0 at its centre, 1 at the border."""
        return self.distance_m / self.region_m


class References:
    """Prepared key spheres of one map."""

    def __init__(self, sphere_map: SphereMap, params: LocalizerParams) -> None:
        self._map = sphere_map
        self._registration, self._params = params.registration, params.reference
        is_large = len(sphere_map.graph) > NUM_ALIKE
        self.appearance = sphere_map.appearance() if is_large else AppearanceIndex()  # a small map is looked at whole
        self.coarse = CoarseReferences(sphere_map.coarse_spheres(), params.registration)
        self.error = MapError(sphere_map.graph, params.covariance)
        self._preparation = Preparation(self._prepare, params.reference.cache_size)
        self.rejections = Rejections()
        self._looked_ahead: NDArray[np.float64] | None = None

    def close(self) -> None:
        """End what is being prepared; nothing can be chosen any more."""
        self._preparation.close()

    def node(self, sphere_id: int) -> KeySphere:
        """Return a key sphere by its id."""
        return self._map.graph[sphere_id]

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
        needed = max(MIN_VISIBLE_SHARE, RELATIVE_SHARE * best)
        usable = [candidates[index] for index in np.flatnonzero(overlaps >= needed)[: self._params.num_references]]
        chosen = usable[:1] + [node for node in usable[1:] if self._is_within_reach(node, T_map_camera)]
        if not chosen:
            return Choice((), (), best, np.inf, np.inf, np.inf)
        views = tuple(View(self._preparation.get(node.id), node.T_map_sphere) for node in chosen)
        distance, typical = distance_of(chosen[0], T_map_camera), self.coarse[chosen[0].id].typical_range_m
        return Choice(tuple(node.id for node in chosen), views, best, distance, typical, self._region(chosen[0]))

    def count_rejections(self, place_map: NDArray[np.float64], residuals: Iterable[Residuals]) -> None:
        """Count which squares of key spheres do not agree with an image; forget those that never do."""
        for view, points, residual in residuals:
            sphere_id = self.nearest(view.T_world_reference.translation, 1)[0].id
            if self.rejections.is_due(sphere_id, place_map) and self.rejections.add(
                sphere_id, place_map, points, residual
            ):
                self._preparation.forget(sphere_id)

    def look_ahead(self, T_map_camera: SE3, velocity: NDArray[np.float64] | None) -> None:
        """Have the key spheres prepared that a camera of some velocity (6,) will need; return at once."""
        step = np.zeros(6) if velocity is None else velocity * AHEAD_S
        point = (T_map_camera @ SE3.exp(step)).translation
        if self._looked_ahead is None or np.linalg.norm(point - self._looked_ahead) > AHEAD_STEP_M:
            self._looked_ahead = point
            self._preparation.begin(node.id for node in self.nearest(point, NUM_AHEAD))

    def _candidates(self, T_map_camera: SE3, camera: Camera) -> tuple[list[KeySphere], NDArray[np.float64]]:
        """Return the nearest key spheres and the share of the image that each covers, 1 for whole spheres."""
        nodes = self.nearest(T_map_camera.translation, NUM_CANDIDATES)
        first = nodes[: self._params.num_references]
        if all(self.coarse[node.id].camera.is_whole for node in first):
            return first, np.ones(len(first))
        coarse = [self.coarse[node.id] for node in nodes]
        T_camera_map = T_map_camera.inverse()
        T_camera_sphere = [T_camera_map @ node.T_map_sphere for node in nodes]
        overlaps = coverage([one.points for one in coarse], T_camera_sphere, camera)
        return nodes, np.where([one.camera.is_whole for one in coarse], 1.0, overlaps)

    def _is_within_reach(self, node: KeySphere, T_map_camera: SE3) -> bool:
        """Say whether a key sphere is near enough to be used beside a nearer one."""
        return distance_of(node, T_map_camera) <= self._region(node)

    def _region(self, node: KeySphere) -> float:
        """Return how far in m a key sphere serves."""
        return node.region_radius_m or UNKNOWN_REACH * self.coarse[node.id].typical_range_m

    def _prepare(self, sphere_id: int) -> Reference:
        """Read a sphere, prepare it and keep the salient pixels of its levels, sorted."""
        sphere = self._map.load_sphere(sphere_id)
        unused = self.rejections.mask(sphere_id, sphere.camera)
        if unused is not None:
            sphere = replace(sphere, range_m=np.where(unused, np.float32(np.nan), sphere.range_m))
        reference = prepare_reference(sphere.grey, sphere.range_m, sphere.camera, self._registration)
        return Reference(tuple(salient(level, KEPT_SHARE) for level in reference.levels))


def distance_of(node: KeySphere, T_map_camera: SE3) -> float:
    """Return the metres between a key sphere and a camera."""
    return float(np.linalg.norm(node.T_map_sphere.translation - T_map_camera.translation))


def coarse_reference(sphere: Sphere, params: RegistrationParams) -> CoarseReference:
    """Return what is kept of a sphere that is small already."""
    finite = sphere.range_m[np.isfinite(sphere.range_m)]
    typical = float(np.median(finite)) if finite.size else np.inf
    reference = prepare_reference(sphere.grey, sphere.range_m, sphere.camera, coarse_params(params))
    points = reference.levels[-1].points
    points = np.ascontiguousarray(points[:, :: max(1, points.shape[1] // NUM_POINTS)].T)
    return CoarseReference(reference, points, sphere.camera, typical)


@cache
def coarse_params(params: RegistrationParams) -> RegistrationParams:
    """Return the parameters with as many levels as small spheres have."""
    return replace(params, pyramid=replace(params.pyramid, num_levels=NUM_COARSE_LEVELS, finest=0))


def salient(level: ReferenceLevel, share: float) -> ReferenceLevel:
    """Return a level reduced to its more salient pixels (M15 section 3.6), ready for a choice among them."""
    number = int(share * level.num_pixels)
    kept = level.most_salient(number) if number >= MIN_KEPT else level
    kept.complete()
    return kept
