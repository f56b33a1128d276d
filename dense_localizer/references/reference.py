"""The key spheres that an image is aligned to: the nearest (M15 eq. 17), prepared once, kept for a while.

They are streamed (`SpherePrefetch`): those of the way ahead are read and prepared by another thread within so much
memory, the longest unused make room; their pixels are chosen (eq. 16) by a third before those chosen for an earlier
image are too old (`PixelPrefetch`). An image of a live camera never waits for either: it is aligned to what is there.
What is prepared does not depend on when; of spheres only the images' own thread decides what is kept, in the order of
its wishes.

A whole sphere sees in every direction, so translation is all that counts: from a little ahead, as a key sphere behind a
camera shows what that sees smaller than the image does. A partial sphere (one camera's view) may
face elsewhere; it is passed over where it covers clearly less of the image than others do.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dense_localizer.constants import (
    GOOD_OVERLAP,
    LEAD_S,
    LOOK_AHEAD,
    MIN_CANDIDATES,
    MIN_SPHERES,
    NUM_CANDIDATES,
    NUM_KEPT,
    PREFETCH_S,
    PREFETCH_STEP_M,
    RELATIVE_SHARE,
)
from dense_localizer.motion_prior import Ground, Prediction
from dense_localizer.params import LocalizerParams
from dense_localizer.references.coarse_reference import CoarseReferences, ExperienceChoice, Sight, Tried
from dense_localizer.references.map_error import MapError
from sphere_nav.geometry import SE3, Camera
from sphere_nav.photometric import Pyramid, Reference, RegistrationParams, View, build_pyramid, prepare_reference
from sphere_nav.photometric.align.problem import RigImage, image_overlap
from sphere_nav.photometric.constants import MAX_SHIFT
from sphere_nav.photometric.pixels.contrast import contrast_window, local_contrast
from sphere_nav.photometric.pixels.pyramid import level_cameras, view_cone
from sphere_nav.photometric.pixels.reference import holds, renew_selection
from sphere_nav.spheres.appearance.index import AppearanceIndex
from sphere_nav.spheres.experiences import split_by_experience
from sphere_nav.spheres.graph import Experience, KeySphere, SphereGraph
from sphere_nav.spheres.sphere import Sphere

Wanted = tuple[Reference, SE3, int]  # where it is from the camera, how many pixels


class PixelPrefetch:
    """The pixels of the key spheres in use, and of the next ones, chosen where the camera will soon be."""

    def __init__(self, params: RegistrationParams, *, is_live: bool) -> None:
        """Of an `is_live` camera no image waits for a choice; others do, so that runs are equal."""
        self._params, self._is_live = params, is_live
        self._thread = ThreadPoolExecutor(1, "choose_pixels")
        self._last = Future[None]()
        self._last.set_result(None)

    def close(self) -> None:
        """End the thread."""
        self._thread.shutdown(wait=True, cancel_futures=True)

    def begin(self, wanted: Iterable[Wanted], camera: Camera) -> None:
        """Have those pixels for a camera chosen anew that will soon be too old; return at once.

        One choice after the other: what is due while one is under way is asked for again with the next image of a live
        camera; others wait.
        """
        if self._is_live and not self._last.done():
            return
        self._last.result()  # raises what it has raised
        due = [one for one in wanted if not holds(one[0].level_like(camera), one[1], camera, one[2], 0.5 * MAX_SHIFT)]
        if due:
            pyramid = self._params.pyramid
            cameras = level_cameras(camera, pyramid.min_side, pyramid.num_levels)
            self._last = self._thread.submit(self._choose, due, cameras[min(pyramid.finest, len(cameras) - 1) :])

    def wait(self) -> None:
        """Wait for what is being chosen, if images do."""
        if not self._is_live:
            self._last.result()

    @staticmethod
    def _choose(due: Sequence[Wanted], cameras: Sequence[Camera]) -> None:
        for reference, T_camera_reference, number in due:
            for camera in cameras:
                renew_selection(reference.level_like(camera), T_camera_reference, camera, number)


class SpherePrefetch:
    """Prepared references by id of their sphere: the latest used, as many of the largest as `memory_bytes` hold."""

    def __init__(self, prepare: Callable[[int], Reference], memory_bytes: float, *, is_live: bool = False) -> None:
        """Of an `is_live` camera, what is not wanted any more is not begun; others read the same whatever the pace."""
        self._prepare, self._memory_bytes, self._is_live = prepare, memory_bytes, is_live
        self._references: OrderedDict[int, Future[Reference]] = OrderedDict()
        self._largest = 0  # bytes, of those that were got
        self._thread = ThreadPoolExecutor(1, "prepare_spheres")

    @property
    def capacity(self) -> int:
        """How many spheres there is room for."""
        return max(MIN_SPHERES, int(self._memory_bytes // self._largest)) if self._largest else MIN_SPHERES

    @property
    def _ready(self) -> list[Reference]:
        done = [future for future in self._references.values() if future.done() and not future.cancelled()]
        return [future.result() for future in done if future.exception() is None]

    def begin(self, sphere_ids: Sequence[int]) -> None:
        """Have spheres prepared that will be needed soon; return at once.

        The first ones first, and no more than there is room for; what is longest unused makes room.
        """
        if self._is_live:  # what cameras have seen of a sphere since it was got counts, too; it depends on the pace
            self._largest = max([self._largest, *(reference.num_bytes for reference in self._ready)])
        wanted = sphere_ids[: self.capacity]
        if self._is_live:
            for sphere_id, future in list(self._references.items()):
                if sphere_id not in wanted and future.cancel():
                    del self._references[sphere_id]
        for sphere_id in wanted:
            self.request(sphere_id)

    def request(self, sphere_id: int) -> None:
        """Have one more sphere prepared; return at once."""
        self._future(sphere_id)

    def get(self, sphere_id: int) -> Reference:
        """Return a prepared sphere as soon as it is ready; raises what reading it raised, and reads again next time."""
        try:
            reference = self._future(sphere_id).result()
        except (ValueError, OSError):
            del self._references[sphere_id]
            raise
        self._largest = max(self._largest, reference.num_bytes)
        return reference

    def find(self, sphere_id: int) -> Reference | None:
        """Return a sphere that was begun before, of a live camera if it is ready; None for one that cannot be read."""
        future = self._references.get(sphere_id)
        if future is None or (self._is_live and not future.done()) or future.exception() is not None:
            return None
        return future.result()

    def is_ready(self, sphere_id: int) -> bool:
        """Say whether `get` would return, or raise, at once."""
        return sphere_id in self._references and self._references[sphere_id].done()

    def close(self) -> None:
        """End the thread; what is being prepared is the last."""
        self._thread.shutdown(wait=True, cancel_futures=True)

    def _future(self, sphere_id: int) -> Future[Reference]:
        if sphere_id not in self._references:
            self._references[sphere_id] = self._thread.submit(self._prepare, sphere_id)
        self._references.move_to_end(sphere_id)
        while len(self._references) > self.capacity:
            self._references.popitem(last=False)[1].cancel()
        return self._references[sphere_id]


class SphereMap(Protocol):
    """A map on disk or in memory."""

    @property
    def graph(self) -> SphereGraph:
        """Where the key spheres are."""
        ...

    @property
    def T_base_sphere(self) -> SE3 | None:
        """The spheres of the first drive on its vehicle, where that is known."""
        ...

    def load_sphere(self, sphere_id: int) -> Sphere:
        """Return one key sphere with its pictures; ValueError or OSError where it cannot be read."""
        ...

    def coarse_spheres(self) -> Mapping[int, Sphere]:
        """Return all key spheres small (`spheres.coarse`); ValueError or OSError where they cannot be read."""
        ...

    def appearance(self) -> AppearanceIndex:
        """Return what the key spheres look like, empty where that is not known; ValueError or OSError for damage."""
        ...


@dataclass(frozen=True)
class Choice:
    """The references of one image; range, region and distance are those of the nearest."""

    ids: tuple[int, ...]
    views: tuple[View, ...]
    overlap: float  # of the best covering one, 0..1
    distance_m: float
    typical_range_m: float
    region_m: float
    by_contrast: bool = False  # their views show local contrast

    @staticmethod
    def merge(choices: Sequence[Choice]) -> Choice:
        """Return the references of several cameras together, none of none."""
        if len(choices) < 2:
            return choices[0] if choices else Choice((), (), 0.0, np.inf, np.inf, np.inf)
        nearest = min(choices, key=lambda choice: choice.distance_m)
        ids = tuple(dict.fromkeys(sphere_id for choice in choices for sphere_id in choice.ids))
        views = tuple(view for choice in choices for view in choice.views)
        return replace(nearest, ids=ids, views=views, overlap=max(choice.overlap for choice in choices))

    @property
    def distance_ratio(self) -> float:
        """Distance to the nearest by the radius of its region: 0 at its center, 1 at the border."""
        return self.distance_m / self.region_m


@dataclass(frozen=True)
class RigChoice:
    """The images of an instant, each with its references, and those of all together."""

    images: tuple[RigImage, ...]
    choice: Choice

    @property
    def covered(self) -> tuple[RigImage, ...]:
        """The images that some reference covers."""
        return tuple(image for image in self.images if image.views)


class References:
    """Prepared key spheres of one map."""

    def __init__(self, sphere_map: SphereMap, params: LocalizerParams, *, is_live: bool = False) -> None:
        """While the camera is followed, `is_live` ones do with what is ready; others wait, so that runs are equal."""
        self._map, self._is_live = sphere_map, is_live
        self._registration, self._params = params.registration, params.reference
        self.appearance = sphere_map.appearance()
        self.coarse = CoarseReferences(sphere_map.coarse_spheres(), params.registration)
        self.error = MapError(sphere_map.graph, params.covariance)
        self.ground = Ground(sphere_map.graph, sphere_map.T_base_sphere)
        self._parts = split_by_experience(sphere_map.graph)
        self._experience = ExperienceChoice(self.coarse)
        self.knows_contrast = params.alignment.contrast  # whether images may be aligned by it
        self.by_contrast = False  # what serves at present
        self._in_contrast = lru_cache(NUM_KEPT)(self._draw_contrast)
        self._spheres = SpherePrefetch(self._prepare, params.reference.memory * 1e6, is_live=is_live)
        self._pixels = PixelPrefetch(params.registration, is_live=is_live)
        self._prefetched: NDArray[np.float64] | None = None
        self._last: tuple[Camera, tuple[int, ...]] | None = None  # camera and key spheres of the last choice
        first = sphere_map.load_sphere(min(sphere_map.graph.nodes)).camera
        self.pixels_per_radian = first.pixels_per_radian
        self._window_rad = contrast_window(first)  # of local contrast, the same in all images and key spheres

    def close(self) -> None:
        """End what is being prepared; nothing can be chosen any more."""
        self._spheres.close()
        self._pixels.close()

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

    def _nearest_in_use(self, point_map: NDArray[np.float64], count: int) -> list[KeySphere]:
        """Return the nearest key spheres of the experience in use."""
        current = self._experience.current
        graph = self._parts.get(current, self._map.graph) if current is not None else self._map.graph
        return graph.nearest(point_map, count)

    def choose_rig(self, images: Sequence[RigImage], prediction: Prediction, instead_of: Tried = ()) -> RigChoice:
        """Return the images of one body with the references of each (M15 eq. 17).

        `instead_of`: experiences that have not explained these images; theirs are those of another one, or none.
        """
        by_contrast = self.by_contrast if prediction.by_contrast is None else prediction.by_contrast
        by_contrast = by_contrast and self.knows_contrast
        choices = []
        for one in images:
            T_map_camera = one.pose(prediction.T_map_camera)
            how = not prediction.is_guess, instead_of, prediction.experience
            sight = Sight(one.pyramid.levels[-1], T_map_camera, *how)
            choices.append(self.choose(sight, one.pyramid.cameras[0], by_contrast=by_contrast))
        chosen = tuple(
            replace(
                one,
                pyramid=self._in_contrast(one.pyramid) if by_contrast and choice.views else one.pyramid,
                views=choice.views,
            )
            for one, choice in zip(images, choices, strict=True)
        )
        return RigChoice(chosen, replace(Choice.merge(choices), by_contrast=by_contrast))

    def choose(self, sight: Sight, camera: Camera, *, by_contrast: bool = False) -> Choice:
        """Return the references for an image taken near a pose: the nearest of those that cover it.

        Where there are several experiences, those of the one that looks like the image. While a live camera is
        followed, the nearest of those that are ready; small ones where none is.
        """
        T_map_camera, never_waits = sight.T_map_camera, self._is_live and sight.is_followed
        self._pixels.wait()
        candidates, overlaps = self._candidates(T_map_camera, camera, NUM_CANDIDATES if never_waits else 0)
        best = float(np.max(overlaps, initial=0.0))
        needed = max(GOOD_OVERLAP, RELATIVE_SHARE * best)
        usable = self._of_experience([candidates[index] for index in np.flatnonzero(overlaps >= needed)], sight)
        ready = [node for node in usable if not never_waits or self._spheres.is_ready(_key(node.id, by_contrast))]
        if not ready and usable:  # for the next image
            self._spheres.request(_key(usable[0].id, by_contrast))
        small = [] if by_contrast or sight.instead_of else usable[:1]  # which explain nothing better
        nearest = ready[: self._params.num_references] or small
        chosen = self._near_enough(nearest, T_map_camera)
        if not chosen:
            return replace(Choice.merge(()), overlap=best)
        keys = [_key(node.id, by_contrast) for node in chosen if ready]
        references = [self._spheres.get(key) for key in keys] or [self.coarse.reference(chosen[0].id)]
        self._last = camera, tuple(node.id for node in chosen)
        views = tuple(View(one, node.T_map_sphere) for one, node in zip(references, chosen, strict=True))
        distance, typical = measure_distance(chosen[0], T_map_camera), self.coarse[chosen[0].id].typical_range_m
        return Choice(self._last[1], views, best, distance, typical, self._region(chosen[0]))

    def covering(self, T_map_camera: SE3, camera: Camera, count: int) -> list[KeySphere]:
        """Return the key spheres near a pose, of any experience, that cover most of what its camera sees."""
        nodes, overlaps = self._candidates(T_map_camera, camera, 0)
        best = np.argsort(-overlaps, kind="stable")[:count]
        return [nodes[index] for index in best.tolist() if overlaps[index] >= GOOD_OVERLAP]

    def _of_experience(self, nodes: list[KeySphere], sight: Sight) -> list[KeySphere]:
        """Return those of the key spheres, nearest first, whose experience looks like the image."""
        if len(self._parts) == 1 or not nodes:
            return [] if sight.instead_of else nodes
        near = sorted(nodes, key=lambda one: measure_distance(one, sight.T_map_camera))
        first: dict[Experience, KeySphere] = {}
        for node in near:
            first.setdefault(node.experience, node)
        within = {
            one: node for one, node in first.items() if measure_distance(node, sight.T_map_camera) <= self._region(node)
        }
        if not (within or sight.instead_of):
            within = {near[0].experience: near[0]}
        chosen = self._experience.choose(within, sight)
        return [node for node in nodes if node.experience == chosen]

    def adopt(self, choice: Choice) -> None:
        """Go on with the experience of references that explained an image, if there were any, and as they showed it."""
        if choice.ids:
            self.by_contrast = choice.by_contrast
            self._experience.current = self.node(choice.ids[0]).experience

    def prefetch(self, T_map_camera: SE3, velocity: NDArray[np.float64] | None, *, is_rig: bool = False) -> None:
        """Have prepared what the camera that chose last, at some velocity (6,), will need; return at once.

        The pixels of cameras of a rig, whose body is at the pose, are chosen when they are needed.
        """
        twist = np.zeros(6) if velocity is None else velocity
        self._last = None if is_rig else self._last
        self._choose_pixels(T_map_camera, twist)
        point = (T_map_camera @ SE3.exp(twist * PREFETCH_S[-1])).translation
        step = max(PREFETCH_STEP_M, LEAD_S * float(np.linalg.norm(twist[:3])))
        if self._prefetched is not None and np.linalg.norm(point - self._prefetched) <= step:
            return
        self._prefetched = point
        wanted: dict[int, None] = {}
        for seconds in PREFETCH_S:
            pose = T_map_camera @ SE3.exp(twist * seconds)
            ahead = pose if self._last is None else self._ahead(pose, self._last[0])
            for node in self._nearest_in_use(ahead.translation, self._params.num_references):
                wanted[_key(node.id, self.by_contrast)] = None
        self._spheres.begin(list(wanted))

    def _choose_pixels(self, T_map_camera: SE3, twist: NDArray[np.float64]) -> None:
        """Have the pixels chosen of the key spheres that are ready where the camera will soon be."""
        if self._last is None:
            return
        camera, last = self._last
        T_soon = T_map_camera @ SE3.exp(twist * LEAD_S)
        nearest = self._nearest_in_use(self._ahead(T_soon, camera).translation, self._params.num_references)
        soon = [node.id for node in self._near_enough(nearest, T_soon)]
        numbers = {(one, self._registration.max_pixels // len(some)) for some in (last, soon) for one in some}
        wanted = []
        for sphere_id, number in sorted(numbers):
            reference = self._spheres.find(_key(sphere_id, self.by_contrast))
            if reference is not None:
                wanted.append((reference, T_soon.inverse() @ self.node(sphere_id).T_map_sphere, number))
        self._pixels.begin(wanted, camera)

    def _draw_contrast(self, pyramid: Pyramid) -> Pyramid:
        """Return an image by its local contrast."""
        level = pyramid.levels[0]
        seen = local_contrast(level.unpadded, level.camera, self._window_rad)
        return build_pyramid(seen, level.camera, self._registration.pyramid)

    def _ahead(self, T_map_camera: SE3, camera: Camera) -> SE3:
        """Return a pose moved towards what the camera sees, where key spheres are whole: one there shows it larger.

        The narrower a view, the farther away is what it shows. A panorama stays where it is.
        """
        nearest = self.coarse[self.nearest(T_map_camera.translation, 1)[0].id]
        if not (nearest.camera.is_whole and np.isfinite(nearest.typical_range_m)):
            return T_map_camera
        *axis, angle = view_cone(camera).tolist()
        share = LOOK_AHEAD * 0.5 * (1.0 + np.cos(angle)) / np.sin(min(angle, 0.5 * np.pi))
        return T_map_camera @ SE3.from_parts(np.eye(3), share * nearest.typical_range_m * np.array(axis))

    def _candidates(self, T_map_camera: SE3, camera: Camera, count: int) -> tuple[list[KeySphere], NDArray[np.float64]]:
        """Return the nearest key spheres, `count` where all are whole, and the share of the image that each covers."""
        nodes = self._nearest_of_all(self._ahead(T_map_camera, camera))
        first = nodes[: count or self._params.num_references] if len(self._parts) == 1 else nodes
        if all(self.coarse[node.id].camera.is_whole for node in first):
            return first, np.ones(len(first))
        pyramid = self._registration.pyramid
        cameras = level_cameras(camera, pyramid.min_side, pyramid.num_levels)
        views = [View(self.coarse.reference(node.id), node.T_map_sphere) for node in nodes]
        overlaps = [image_overlap(cameras, [view], T_map_camera) for view in views]
        return nodes, np.where([self.coarse[node.id].camera.is_whole for node in nodes], 1.0, overlaps)

    def _nearest_of_all(self, T_map_camera: SE3) -> list[KeySphere]:
        """Return the nearest key spheres, of several experiences as many of each, nearest first."""
        point, count = T_map_camera.translation, max(NUM_CANDIDATES // len(self._parts), MIN_CANDIDATES)
        if len(self._parts) == 1:
            return self.nearest(point, NUM_CANDIDATES)
        nodes = [node for part in self._parts.values() for node in part.nearest(point, count)]
        return sorted(nodes, key=lambda node: (measure_distance(node, T_map_camera), node.id))

    def _near_enough(self, nodes: list[KeySphere], T_map_camera: SE3) -> list[KeySphere]:
        """Return the first key sphere, and those that are near enough to be used beside it."""
        return nodes[:1] + [node for node in nodes[1:] if measure_distance(node, T_map_camera) <= self._region(node)]

    def _region(self, node: KeySphere) -> float:
        """Return how far in m a key sphere serves."""
        return node.region_radius_m or self.coarse[node.id].typical_range_m

    def _prepare(self, key: int) -> Reference:
        """Read a sphere and prepare it."""
        sphere_id = _sphere_id(key)
        sphere = self._map.load_sphere(sphere_id)
        levels, range_m, camera = sphere.levels, sphere.range_m, sphere.camera
        del sphere  # colors take more than the grey levels
        if key != sphere_id:
            levels = local_contrast(levels, camera, self._window_rad)
        return prepare_reference(levels, range_m, camera, self._registration)


def _key(sphere_id: int, by_contrast: bool) -> int:
    """Return under what a key sphere is prepared: its id, below zero by local contrast."""
    return ~sphere_id if by_contrast else sphere_id


def _sphere_id(key: int) -> int:
    return ~key if key < 0 else key


def measure_distance(node: KeySphere, T_map_camera: SE3) -> float:
    """Return the meters between a key sphere and a camera."""
    return float(np.linalg.norm(node.T_map_sphere.translation - T_map_camera.translation))
