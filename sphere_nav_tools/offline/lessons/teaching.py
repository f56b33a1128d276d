"""A drive that a map explained badly becomes an experience of it: its images, with the range that the map has there.

A camera alone has no range. But the localiser knows, however badly the image resembled the map, where it was taken,
and the map knows how far everything is. So each image that was not explained becomes a key sphere: the grey levels of
now, the range of then, drawn from where the camera was (as M15 section 5.3 does from one image to the next). Poses of
the map stay as they are. What earlier drives have contradicted again and again loses its range (M15 section 6.4.5).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from dense_localizer.references.rejections import Rejections
from sphere_mapping.acquisition.partial.partial_sphere import sphere_from_rgbd
from sphere_mapping.experiences.budget import Budget, Thinned, thin
from sphere_nav.estimation.normal_equations import symmetric_inverse
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.ros.conversions import message_to_sphere, sphere_to_message
from sphere_nav.ros.maps.condensing import condense, condense_message, count_bytes, count_compressed
from sphere_nav.ros.maps.reader import MapDetails, MapReader
from sphere_nav.ros.maps.writer import SPHERE_FRAME, Stored, write_stored
from sphere_nav.spheres.appearance.features import features_of_sphere
from sphere_nav.spheres.coarse import coarse_sphere
from sphere_nav.spheres.experiences import Service, count_image, with_service
from sphere_nav.spheres.graph import Edge, Experience, KeySphere, SphereGraph
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, Range, Sphere
from sphere_nav.view_synthesis.region import region_radius
from sphere_nav.view_synthesis.surface import surface_of
from sphere_nav.view_synthesis.synthesis import PlacedSurface, synthesize
from sphere_nav_tools.offline.constants import KEY_FLOOR, MIN_MEASURED, NUM_DRAWN, TEACH_REACH, TEACH_TURN
from sphere_nav_tools.offline.forgetting import without
from sphere_nav_tools.offline.lessons.kept_drives import KeptDrive, KeyImage


@dataclass(frozen=True)
class Lesson:
    """What becomes of the images of a drive: those that are taught, and those by which the new map is judged."""

    taught: tuple[KeyImage, ...]
    withheld: tuple[KeyImage, ...]

    @classmethod
    def of(cls, drive: KeptDrive, graph: SphereGraph) -> Lesson:
        """Teach images that were not explained, as far apart as key spheres are; those between them judge."""
        parts: tuple[list[KeyImage], list[KeyImage]] = [], []
        for one in drive.images():
            if not one.is_explained:
                is_near = any(_is_near(one, other, graph) for other in parts[0])
                parts[is_near].append(one)
        return cls(tuple(parts[0]), tuple(parts[1]))


def _is_near(one: KeyImage, other: KeyImage, graph: SphereGraph) -> bool:
    """Say whether two images show the same, by the region of the key sphere nearest to one."""
    meters, radians = one.T_map_camera.distance(other.T_map_camera)
    region_m = graph.nearest(one.T_map_camera.translation)[0].region_radius_m
    return bool(meters <= TEACH_REACH * region_m and radians <= TEACH_TURN)


def teach(
    base: MapReader,
    drive: KeptDrive,
    taught: Sequence[KeyImage],
    target: Path,
    rejections: Rejections,
    name: str = "",
    budget: Budget | None = None,
) -> int:
    """Write the map that also knows a drive; return how many key spheres were added. OSError leaves nothing."""
    experience = Experience(name, _describe(taught), drive.name, min(one.stamp_ns for one in taught))
    spheres, nodes, edges = dict[int, Sphere](), list[KeySphere](), list[Edge]()
    for one in taught:
        sphere, T_map_sphere, covariance = make_sphere(base, one)
        if float(np.mean(sphere.measured)) < MIN_MEASURED:
            continue
        new_id = max(base.graph.nodes) + 1 + len(nodes)
        radius = region_radius(sphere)
        nodes.append(KeySphere(new_id, one.stamp_ns, T_map_sphere, region_radius_m=radius, experience=experience))
        edges.append(_edge(base.graph, one, nodes[-1], covariance))
        spheres[new_id] = sphere
    graph = _with_drive(base.graph, drive, nodes, edges)
    index = base.appearance()
    for node in graph:
        if node.id not in index.features:
            load = spheres.__getitem__ if node.id in spheres else base.load_sphere
            index.add(node.id, features_of_sphere(load(node.id)))
    thinned = Thinned(graph) if budget is None else _thin(graph, budget, base, spheres)
    info = base.info
    details = MapDetails(
        map_id=str(info.map_id),  # the frame and the poses of the map are those of before
        source=f"{info.source} + {drive.name}",
        parameters=base.parameters,
        rig=info.rig,
        frame_id=info.header.frame_id,
    )
    stored = condense(_stored(base, spheres, rejections), thinned.condensed)
    write_stored(target, thinned.graph, details, index, stored)
    return len(spheres.keys() & thinned.graph.nodes.keys())


def make_sphere(base: MapReader, one: KeyImage) -> tuple[Sphere, SE3, Array]:
    """Return an image as a sphere with the range of the map, T_map_sphere, and its covariance (6, 6)."""
    range_m = draw_range(base, one)
    image = np.maximum(one.image, 1)
    if isinstance(one.camera, Spherical):
        return Sphere(image, range_m, one.camera, one.stamp_ns), one.T_map_camera, one.covariance
    depth = range_m * pixel_rays(one.camera)[..., 2].astype(np.float32)
    sphere = sphere_from_rgbd(image, depth, one.camera, T_BODY_OPTICAL, one.stamp_ns)
    Ad = T_BODY_OPTICAL.adjoint()
    return sphere, one.T_map_camera @ T_BODY_OPTICAL.inverse(), Ad @ one.covariance @ Ad.T


def draw_range(base: MapReader, one: KeyImage) -> Range:
    """Return the range (H, W) in m that an image would have by the map; NaN where the map does not say.

    Key spheres are not blended: small errors of their poses would bring the nearer one to the front everywhere.
    """
    near = [node.id for node in base.graph.nearest(one.T_map_camera.translation, NUM_DRAWN)]
    known = [sphere_id for sphere_id in one.references if sphere_id in base.graph.nodes]
    range_m = np.full(one.image.shape, np.nan, np.float32)
    for sphere_id in dict.fromkeys([*known, *near]):
        placed = PlacedSurface(surface_of(base.load_sphere(sphere_id)), base.graph[sphere_id].T_map_sphere)
        drawn = synthesize([placed], one.T_map_camera, one.camera).range_m
        range_m = np.where(np.isnan(range_m), drawn, range_m)
    return range_m


def _describe(taught: Sequence[KeyImage]) -> str:
    camera = taught[0].camera
    return f"learned {camera.width} x {camera.height}"


def _edge(graph: SphereGraph, one: KeyImage, node: KeySphere, covariance: Array) -> Edge:
    """Return what was measured between a new key sphere and the one of the map that placed it."""
    known = [sphere_id for sphere_id in one.references if sphere_id in graph.nodes]
    origin = graph[known[0]] if known else graph.nearest(node.T_map_sphere.translation)[0]
    T = origin.T_map_sphere.inverse() @ node.T_map_sphere
    return Edge(origin.id, node.id, T, symmetric_inverse(covariance + np.diag(KEY_FLOOR)), is_loop=True)


def _with_drive(graph: SphereGraph, drive: KeptDrive, nodes: list[KeySphere], edges: list[Edge]) -> SphereGraph:
    """Return the graph with the key spheres of a drive, and what they and the others explain of it.

    What the map did not explain is explained by the new key sphere nearest to it.
    """
    served, own = dict[int, Service](), dict[int, Service]()
    for one in drive.images():
        if one.is_explained and one.references and one.references[0] in graph.nodes:
            count_image(served, one.references[0], one.stamp_ns)
        elif not one.is_explained and nodes:
            nearest = SphereGraph(nodes).nearest(one.T_map_camera.translation)[0]
            count_image(own, nearest.id, one.stamp_ns)
    return with_service(SphereGraph([*graph, *nodes], [*graph.edges, *edges]), served, own)


def _thin(graph: SphereGraph, budget: Budget, base: MapReader, spheres: dict[int, Sphere]) -> Thinned:
    is_whole = base.load_sphere(min(base.graph.nodes)).camera.is_whole
    return thin(graph, budget, partial(_count_bytes, base, spheres), is_whole=is_whole)


def _count_bytes(base: MapReader, spheres: dict[int, Sphere], sphere_id: int, is_condensed: bool) -> float:
    if sphere_id not in spheres:
        return count_bytes(base, sphere_id, is_condensed)
    whole, _ = _message(sphere_id, spheres[sphere_id])
    size = count_compressed(condense_message(whole) if is_condensed else whole)
    return size + base.num_other_bytes / len(base.graph)


def _stored(base: MapReader, spheres: dict[int, Sphere], rejections: Rejections) -> Iterator[Stored]:
    """Yield all key spheres in order of their ids, whole and small, without the range that is forgotten."""
    for whole, small in base.stored():
        sphere_id = int(whole.id)
        if rejections.share(sphere_id):
            yield _message(sphere_id, without(message_to_sphere(whole), rejections, sphere_id))
        else:
            yield whole, small
    for sphere_id, sphere in sorted(spheres.items()):
        yield _message(sphere_id, sphere)


def _message(sphere_id: int, sphere: Sphere) -> Stored:
    whole = sphere_to_message(sphere, SPHERE_FRAME, sphere_id)
    return whole, sphere_to_message(coarse_sphere(sphere), SPHERE_FRAME, sphere_id)
