"""What the key spheres of a map have seen it in: a place holds several by appearance, of day, light, season, camera."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from sphere_nav.spheres.constants import FADING, PLACE_REACH, PLACE_TURN
from sphere_nav.spheres.graph import Experience, KeySphere, SphereGraph


@dataclass(frozen=True)
class Service:
    """How many images of a drive a key sphere explained, a part of one by the part, and the stamp of the last one."""

    num_images: float
    last_ns: int


def count_image(served: dict[int, Service], sphere_id: int, stamp_ns: int) -> None:
    """Note one more image that a key sphere explains; images come in the order of their stamps."""
    served[sphere_id] = Service(served.get(sphere_id, Service(0.0, 0)).num_images + 1.0, stamp_ns)


def split_by_experience(graph: SphereGraph) -> dict[Experience, SphereGraph]:
    """Return the key spheres of each experience, without edges, in the order of the graph."""
    found: dict[Experience, list[KeySphere]] = {}
    for node in graph:
        found.setdefault(node.experience, []).append(node)
    return {experience: SphereGraph(nodes) for experience, nodes in found.items()}


def with_experience(graph: SphereGraph, experience: Experience, ids: Iterable[int]) -> SphereGraph:
    """Return the graph with some key spheres of an experience."""
    return graph.with_nodes({node_id: {"experience": experience} for node_id in ids})


def with_service(
    graph: SphereGraph, served: dict[int, Service], own: dict[int, Service] | None = None, first: float | None = None
) -> SphereGraph:
    """Return the graph after one more drive: for each key sphere the images that it explains in a drive of its light.

    served: by id what key spheres explained of the drive; own: those that it added, and what they alone explain of it.
    A mean, in which later drives count more, and each as much as its light was used in it: what served by day does not
    fade by night, and what has been driven in once is worth as much as what has been driven in often. Key spheres that
    nobody has counted, those of a first day, begin with the `first` so many images; None: as the drive's own ones.
    """
    told, own = served | (own or {}), own or {}
    total = max(sum(one.num_images for one in told.values()), 1)
    shares = dict.fromkeys(split_by_experience(graph), 0.0)
    for node in graph:
        shares[node.experience] += told[node.id].num_images / total if node.id in told else 0.0
    first = sum(one.num_images for one in own.values()) / max(len(own), 1) if first is None else first
    changes = {}
    for node in graph:
        new = told.get(node.id, Service(0, node.last_served_ns or (node.stamp_ns if own else 0)))
        is_counted = node.last_served_ns > 0
        before = node.served if is_counted else first
        mean = before + (1.0 - FADING) * (new.num_images - shares[node.experience] * before)
        begins = node.id in own or not (is_counted or own)
        changes[node.id] = {"served": float(new.num_images) if begins else mean, "last_served_ns": new.last_ns}
    return graph.with_nodes(changes)


def find_places(graph: SphereGraph, *, is_whole: bool) -> dict[int, dict[Experience, float]]:
    """Return for each key sphere what experiences its place holds, and the images that those served there."""
    places: dict[int, dict[Experience, float]] = {}
    for node in graph:
        found = {node.experience: 0.0}
        for other in graph.near(node.T_map_sphere.translation, PLACE_REACH * node.region_radius_m):
            _, angle = node.T_map_sphere.distance(other.T_map_sphere)
            if is_whole or float(angle) <= PLACE_TURN:
                found[other.experience] = found.get(other.experience, 0.0) + other.served
        places[node.id] = found
    return places
