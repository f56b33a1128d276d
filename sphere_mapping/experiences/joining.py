"""READ FIRST. A drive in the frame of a map, whatever light it was driven in.

Where the localizer tracked the drive in the map, its poses are joins. Where it did not, places are found by their
features and aligned by their images, or by parts of these. A start that is given is confirmed by parts, else by ranges
over all places that both saw. Between joins the drive's own motions hold, with their covariances. The map stays where
it is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from scipy.special import bdtrc

from sphere_mapping.constants import (
    ASIDE,
    FALSE_FIT,
    MAX_AWAY,
    MIN_LOCATED_SHARE,
    NUM_ASIDE,
    NUM_PASSES,
)
from sphere_mapping.experiences.parts import refine_by_parts, search_by_parts
from sphere_mapping.graph.both_ways import least_variances
from sphere_mapping.graph.extension import Submap, agreeing, find_joins, join_closely, join_graphs
from sphere_mapping.graph.keyframes import Track
from sphere_mapping.graph.loop_closure import away
from sphere_mapping.graph.verification import Run
from sphere_nav.estimation.least_squares import RARE, symmetric_inverse
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph
from sphere_nav.spheres.range_alignment import (
    RangeImage,
    assess_ranges,
    fit_both_ways,
    reconcile,
)
from sphere_nav.spheres.sphere import Sphere


@dataclass(frozen=True, eq=False)
class Localized:
    """Where the localizer saw a sphere of the drive: T_a_sphere by key sphere `a` of the map, covariance (6, 6).

    is_sure: the localizer was in TRACKING.
    """

    a: int
    T_a_sphere: SE3
    covariance: Array
    is_sure: bool


@dataclass(frozen=True, eq=False)
class DriveSphere:
    """A sphere of the drive: by the key sphere before it, where the localizer saw it, and its small picture."""

    track: Track
    located: Localized | None
    load_small: Callable[[], Sphere]

    @cached_property
    def ranges(self) -> RangeImage:
        """What alignment by ranges needs of it, prepared once: passes compare the same images."""
        return RangeImage.from_sphere(self.load_small())


@dataclass(frozen=True, eq=False)
class Place:
    """A key sphere of the map and the image of the drive that is nearest to it, T_node_image as far as it is known."""

    node: KeySphere
    image: DriveSphere
    T_node_image: SE3

    def moved(self, by_m: Array) -> SE3:
        """Return T_node_image with the drive moved by (3,) m in the map."""
        in_node = self.node.T_map_sphere.rotation.T @ by_m
        return SE3.from_parts(self.T_node_image.rotation, self.T_node_image.translation + in_node)


@dataclass(frozen=True, eq=False)
class Joined:
    """One graph of both, in the frame of the map, and in words how the drive was placed; None where it was not."""

    graph: SphereGraph | None
    told: str


@dataclass(frozen=True, eq=False)
class First:
    """What says first where the drive was; `is_certain`: it needs no confirmation."""

    edges: list[Edge]
    told: str
    is_certain: bool = True


def join_drive(
    base: Submap,
    drive: Submap,
    images: Sequence[DriveSphere],
    T_map_start: SE3 | None = None,
    run: Run = map,
) -> Joined:
    """Join a drive to a map; `T_map_start` is where its first sphere was, as somebody says, to half a meter."""
    load_base = cache(lambda sphere_id: RangeImage.from_sphere(base.load(sphere_id)))
    first = find_first(base, drive, images, T_map_start, run, load_base)
    if not first.edges:
        return Joined(None, first.told)
    joined = Joined(join_graphs(base.graph, drive.graph, first.edges), first.told)
    if not first.is_certain:
        joined = confirm_by_ranges(base.graph, drive.graph, images, joined, load_base)
    if joined.graph is None:
        return joined
    return Joined(join_closely(base, drive, joined.graph, run), joined.told)


def find_first(
    base: Submap,
    drive: Submap,
    images: Sequence[DriveSphere],
    T_map_start: SE3 | None,
    run: Run,
    load_base: Callable[[int], RangeImage],
) -> First:
    """Return joins by the localizer, else by a given start, else by features and images, else by parts of these."""
    located = agreeing(base.graph, drive.graph, list(locate_edges(images)))
    told = f"the localizer placed {len(located)} of {len(drive.graph)} key spheres"
    if located:
        first = First(located, told)
        is_partly = len(located) < MIN_LOCATED_SHARE * len(drive.graph)
        return confirm_by_parts(base, drive, first) if is_partly else first
    if T_map_start is not None:
        node, anchor = next(iter(drive.graph)), next(iter(base.graph))
        T_a_b = anchor.T_map_sphere.inverse() @ T_map_start
        start = Edge(anchor.id, node.id, T_a_b, np.eye(6), is_loop=True)
        given = First([start], f"{told}; a start was given", is_certain=False)
        return confirm_by_parts(base, drive, given)
    joins = find_joins(base, drive, run)
    if joins.edges:
        return First(joins.edges, f"{told}; {joins}")
    found = search_by_parts(base, drive, load_base)
    searched = First(found, f"{told}; {joins}")
    return confirm_by_parts(base, drive, searched) if found else searched


def confirm_by_parts(base: Submap, drive: Submap, first: First) -> First:
    """Return joins by parts of the images from where the drive is thought to be, beside certain ones; else the same."""
    joined = join_graphs(base.graph, drive.graph, first.edges)
    found = refine_by_parts(base, drive, joined)
    told = f"{first.told}; parts of the images agree at {len(found)} of {len(drive.graph)} key spheres"
    edges = agreeing(base.graph, drive.graph, [*(first.edges if first.is_certain else ()), *found]) if found else []
    return First(edges, told) if edges else first


def confirm_by_ranges(
    base: SphereGraph,
    drive: SphereGraph,
    images: Sequence[DriveSphere],
    given: Joined,
    load_base: Callable[[int], RangeImage],
) -> Joined:
    """Return the drive where ranges put it from a given start; without a graph where they fit by chance, or elsewhere.

    Joins that came by chance would be as rare as is stated, also where much of the place has changed.
    """
    told, joined, num_joins, num_tried = given.told, given.graph, 0, 0
    for _ in range(NUM_PASSES):  # each time from where the last one ended
        if joined is None:
            return Joined(None, told)
        found, num_alike, num_tried = refine_by_ranges(base, joined, images, load_base)
        told = f"{given.told}; ranges fit at {num_alike} of {num_tried} places, {len(found)} tell where"
        edges = agreeing(base, drive, found)
        num_joins, joined = len(edges), join_graphs(base, drive, edges) if edges else None
    if joined is None or bdtrc(num_joins - 1, num_tried, FALSE_FIT) > RARE:
        return Joined(None, told)
    rival_m = find_rival(find_places(base, joined, images, load_base), load_base)
    return Joined(None, f"{told}; ranges fit as well {rival_m:g} m away") if rival_m else Joined(joined, told)


def locate_edges(images: Sequence[DriveSphere]) -> Iterator[Edge]:
    """Yield for each key sphere of the drive the join by the nearest image that the localizer was sure of."""
    nearest: dict[int, tuple[float, DriveSphere]] = {}
    for image in images:
        away_m = float(np.linalg.norm(image.track.T_key_sphere.translation))
        if image.located is not None and image.located.is_sure:
            known = nearest.get(image.track.key_id)
            if known is None or away_m < known[0]:
                nearest[image.track.key_id] = away_m, image
    for away_m, image in nearest.values():
        assert image.located is not None
        one = image.located
        yield edge_to_key(one.a, image.track, one.T_a_sphere, one.covariance, least_variances(away_m))


def edge_to_key(a: int, track: Track, T_a_sphere: SE3, covariance: Array, floor: Array) -> Edge:
    """Return the join of `a` with the key sphere before a sphere, by where that is and the variances (6,) between."""
    adjoint = track.T_key_sphere.adjoint()
    information = symmetric_inverse(adjoint @ covariance @ adjoint.T + np.diag(floor))
    return Edge(a, track.key_id, T_a_sphere @ track.T_key_sphere.inverse(), information, is_loop=True)


def refine_by_ranges(
    base: SphereGraph, joined: SphereGraph, images: Sequence[DriveSphere], load_base: Callable[[int], RangeImage]
) -> tuple[list[Edge], int, int]:
    """Return joins of the map's key spheres with the image of the drive that is nearest to each, by ranges.

    And at how many places ranges fit both ways, which speaks for the place where they do not tell it well enough for a
    join, of how many that were compared. `joined`: both, as far as it is known.
    """
    found, num_alike = list[Edge](), 0
    places = find_places(base, joined, images, load_base)
    for place in places:
        ways = fit_both_ways(load_base(place.node.id), place.image.ranges, place.T_node_image)
        num_alike += ways is not None
        fit = ways and reconcile(*ways)
        if fit is not None:
            found.append(edge_to_key(place.node.id, place.image.track, fit.T_a_b, fit.covariance, np.zeros(6)))
    return found, num_alike, len(places)


def find_places(
    base: SphereGraph, joined: SphereGraph, images: Sequence[DriveSphere], load_base: Callable[[int], RangeImage]
) -> list[Place]:
    """Return the map's key spheres with the image of the drive that is nearest to each, where that is near.

    Where the localizer was sure of that image it says more than ranges do.
    """
    found = []
    for node in base:
        motions = [node.T_map_sphere.inverse() @ joined[one.track.key_id].T_map_sphere @ one.track.T_key_sphere
                   for one in images]  # fmt: skip
        apart = [away(T, node.region_radius_m or 1.0, load_base(node.id).camera.is_whole) for T in motions]
        best = int(np.argmin(apart))
        located = images[best].located
        if apart[best] <= MAX_AWAY and not (located is not None and located.is_sure):
            found.append(Place(node, images[best], motions[best]))
    return found


def find_rival(places: Sequence[Place], load_base: Callable[[int], RangeImage]) -> float:
    """Return how far away in m the ranges of all places agree as well as where they are, or better; 0: nowhere near.

    An alignment stops where it was begun along a street that looks alike for some meters; and where a place is not the
    one that it is taken for, it is often because streets are alike. There agreement falls little from meter to meter.
    """
    pairs = [(load_base(place.node.id), place.image.ranges, place) for place in places]
    headings = np.linspace(0.0, 2.0 * np.pi, NUM_ASIDE, endpoint=False)

    def agreement(away_m: float, heading: float) -> float:
        move = away_m * np.array([np.cos(heading), np.sin(heading), 0.0])
        fits = [assess_ranges(a, b, place.moved(move)) for a, b, place in pairs]
        return float(np.mean([fit.agreement if fit is not None else 0.0 for fit in fits]))

    here = agreement(0.0, 0.0)
    for away_m, lead in ASIDE:
        if max(agreement(away_m, heading) for heading in headings) > here - lead:
            return away_m
    return 0.0
