"""`sphere_nav map-learn`: a map learns from the drives that were kept beside it, one after the other. READ FIRST.

A drive that was tracked badly becomes an experience: its images, with the range that the map has there (as M15 section
5.3 does from one image to the next); poses of the map stay as they are. The copy that knows them must explain more
images that were withheld, and no fewer of other drives. Then it replaces the map, which stays as `.previous`.
"""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, count
from pathlib import Path
from typing import Any

import numpy as np

from dense_localizer.constants import MIN_EXPLAINED_NCC
from dense_localizer.key_images import is_lesson
from dense_localizer.localizer import Localizer
from dense_localizer.motion_prior import measure_position_sigma
from dense_localizer.params import DenseLocalizerParams, LocalizerParams
from dense_localizer.ros.drive_recorder import EXPLAINED, IMAGE, INFO, POSE, SPHERE_INFO, STATUS, drives_of
from sphere_mapping.acquisition.partial.partial_sphere import sphere_from_rgbd
from sphere_nav.estimation.least_squares import symmetric_inverse
from sphere_nav.geometry import SE3, Camera, Spherical
from sphere_nav.geometry.arrays import Array, Bytes, Floats
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.params import build
from sphere_nav.ros import conversions
from sphere_nav.ros.bags import BagReader
from sphere_nav.ros.bags.writer import PARTIAL
from sphere_nav.ros.maps.reader import MapDetails, MapReader, open_map
from sphere_nav.ros.maps.writer import Stored, as_stored, replace_map, write_stored
from sphere_nav.spheres.graph import Edge, Experience, KeySphere, SphereGraph
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, Sphere
from sphere_nav.view_synthesis.region import region_radius
from sphere_nav.view_synthesis.surface import surface_of
from sphere_nav.view_synthesis.synthesis import PlacedSurface, synthesize
from sphere_nav_tools.offline.constants import (
    KEY_FLOOR,
    MAX_EXAMINED,
    MAX_JUDGES,
    MAX_OFF,
    MIN_MEASURED,
    MIN_OFF_M,
    NUM_DRAWN,
    TEACH_REACH,
    TEACH_TURN,
)
from sphere_nav_tools.offline.settings import add, add_settings

PREVIOUS, NEXT = ".previous", ".next"  # end names beside the map
HELP = """\
Learn from the drives that the localiser has kept beside a map (its parameter learn): a drive that the map explained
badly, in another light for instance, becomes an experience of it. A copy of the map learns it and is examined by the
images that were withheld of that drive and by the other drives: it must explain more of the one, and no fewer of the
others. Then it takes the place of the map, which stays as MAP.previous; frame, poses and taught paths stay. A localiser
that runs goes on with the map that it has opened. Exit status 1 where nothing was learned.

examples:
  sphere_nav localize campus evening -o poses.tum --set learn=true
  sphere_nav map-learn campus
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add(parser, "map", "MAP", "a map (a folder)", Path)
    add_settings(parser, "dense_localizer")


def run(arguments: argparse.Namespace) -> int:
    """Learn."""
    path: Path = (arguments.map.parent if arguments.map.is_file() else arguments.map).resolve()
    learned = []
    for name, is_taken, told in learn_map(path, build(DenseLocalizerParams, {"automatic": False} | arguments.settings)):
        print(f"{name}: {'learned' if is_taken else 'refused'}: {told}")
        learned.append(is_taken)
    print(f"{arguments.map}: {sum(learned)} of {len(learned)} drives learned")
    return 0 if any(learned) else 1


@dataclass(frozen=True, eq=False)
class KeyImage:
    """An image of one camera, where it was in the map with its covariance (6, 6), and what the map was to it."""

    stamp_ns: int
    image: Bytes
    camera: Camera
    T_map_camera: SE3
    covariance: Array
    references: tuple[int, ...]
    is_explained: bool


class KeptDrive:
    """A drive in a folder: the map that it was driven in, and which of its key images that explained."""

    def __init__(self, path: Path, frame_id: str) -> None:
        self.path, self.name, self._frame_id = path, path.name, frame_id
        with BagReader(path) as bag:
            self.map_id = next((str(item.message.map_id) for item in bag.messages([STATUS])), "")
            self.explained = [bool(item.message.data) for item in bag.messages([EXPLAINED])]

    def images(self) -> Iterator[KeyImage]:
        """Yield the images in order of time; they are read anew each time."""
        told: dict[str, Any] = {}
        with BagReader(self.path) as bag:
            for topic, stamp, message in bag.messages():
                told[topic] = message
                if topic == IMAGE:  # the last of each
                    pose = conversions.pose_with_covariance_to_se3(told[POSE], self._frame_id)
                    yield KeyImage(
                        stamp,
                        conversions.image_to_array(message).copy(),
                        conversions.sphere_info_to_camera(told[SPHERE_INFO])
                        if SPHERE_INFO in told
                        else conversions.camera_from_info(told[INFO]),
                        *pose,
                        conversions.message_to_status(told[STATUS]).references,
                        bool(told[EXPLAINED].data),
                    )


def list_drives(map_path: Path) -> list[KeptDrive]:
    """Return the drives that were kept in a map of the present frame, the oldest first; BagError for damage."""
    with open_map(map_path) as reader:
        frame_id, map_id = str(reader.info.header.frame_id), str(reader.info.map_id)
    paths = [path for path in sorted(drives_of(map_path).glob("*")) if path.suffix != PARTIAL]
    return [drive for drive in (KeptDrive(path, frame_id) for path in paths) if drive.map_id == map_id]


def known_drives(map_path: Path) -> set[str]:
    """Return the names of the drives that a map knows."""
    with open_map(map_path) as reader:
        return {node.experience.drive for node in reader.graph}


def learn_map(map_path: Path, params: LocalizerParams) -> Iterator[tuple[str, bool, str]]:
    """Learn the drives that a map explained badly; yield each, whether the map knows it now, and why, in words.

    OSError: the map is as it was.
    """
    drives, known = list_drives(map_path), known_drives(map_path)
    for drive in drives:
        if drive.name not in known and is_lesson(drive.explained):
            yield drive.name, *_learn(map_path, drive, [one for one in drives if one is not drive], params)


def _learn(map_path: Path, drive: KeptDrive, others: Sequence[KeptDrive], params: LocalizerParams) -> tuple[bool, str]:
    """Make the map that knows a drive, examine both, and swap them if it is better; return that in words."""
    new = map_path.with_name(map_path.name + NEXT)
    for left in (new, new.with_name(new.name + PARTIAL)):
        shutil.rmtree(left, ignore_errors=True)  # of a killed process
    try:
        with open_map(map_path) as base:
            taught, withheld = split_lesson(drive, base.graph)
            number = teach(base, drive, taught, new)
        told, is_better = examine((map_path, new), withheld, others, params)
        if is_better:
            swap(map_path, new)
        return is_better, f"{number} key spheres; {told}"
    finally:
        shutil.rmtree(new, ignore_errors=True)


def swap(map_path: Path, new: Path) -> None:
    """Keep the map as `.previous`, and put the new one in its place: whatever ends this, the map is a whole one."""
    previous = map_path.with_name(map_path.name + PREVIOUS)
    shutil.rmtree(previous, ignore_errors=True)
    shutil.copytree(map_path, previous)
    replace_map(new, map_path)


def split_lesson(drive: KeptDrive, graph: SphereGraph) -> tuple[list[KeyImage], list[KeyImage]]:
    """Return the images that are taught, as far apart as key spheres are, and those between them, which judge."""
    taught, withheld = list[KeyImage](), list[KeyImage]()
    for one in drive.images():
        if not one.is_explained:
            is_near = any(_is_near(one, other, graph) for other in taught)
            (withheld if is_near else taught).append(one)
    return taught, withheld


def _is_near(one: KeyImage, other: KeyImage, graph: SphereGraph) -> bool:
    """Say whether two images show the same, by the region of the key sphere nearest to one."""
    meters, radians = one.T_map_camera.distance(other.T_map_camera)
    region_m = graph.nearest(one.T_map_camera.translation)[0].region_radius_m
    return bool(meters <= TEACH_REACH * region_m and radians <= TEACH_TURN)


def teach(base: MapReader, drive: KeptDrive, taught: Sequence[KeyImage], target: Path) -> int:
    """Write the map that also knows images of a drive; return how many key spheres were added."""
    camera = taught[0].camera
    what, ids = f"learned {camera.width} x {camera.height}", count(max(base.graph.nodes) + 1)
    experience = Experience("", what, drive.name, min(one.stamp_ns for one in taught))
    nodes, edges, stored = list[KeySphere](), list[Edge](), list[Stored]()
    for one in taught:
        sphere, T_map_sphere, covariance = make_sphere(base, one)
        if np.mean(sphere.measured) >= MIN_MEASURED:
            new_id, radius = next(ids), region_radius(sphere)
            nodes.append(KeySphere(new_id, one.stamp_ns, T_map_sphere, region_radius_m=radius, experience=experience))
            edges.append(_edge(base.graph, one, nodes[-1], covariance))
            stored.append(as_stored(new_id, sphere))
    graph = SphereGraph([*base.graph, *nodes], [*base.graph.edges, *edges])
    info, source = base.info, f"{base.info.source} + {drive.name}"  # frame, poses and id are those of before
    details = MapDetails(
        str(info.map_id), source=source, parameters=base.parameters, rig=info.rig, frame_id=info.header.frame_id
    )
    write_stored(target, graph, details, base.appearance(), chain(base.stored(), stored))
    return len(nodes)


def make_sphere(base: MapReader, one: KeyImage) -> tuple[Sphere, SE3, Array]:
    """Return an image as a sphere with the range of the map, T_map_sphere, and its covariance (6, 6)."""
    range_m, image = draw_range(base, one), np.maximum(one.image, 1)
    if isinstance(one.camera, Spherical):
        return Sphere(image, range_m, one.camera, one.stamp_ns), one.T_map_camera, one.covariance
    depth = range_m * pixel_rays(one.camera)[..., 2].astype(np.float32)
    sphere = sphere_from_rgbd(image, depth, one.camera, T_BODY_OPTICAL, one.stamp_ns)
    Ad = T_BODY_OPTICAL.adjoint()
    return sphere, one.T_map_camera @ T_BODY_OPTICAL.inverse(), Ad @ one.covariance @ Ad.T


def draw_range(base: MapReader, one: KeyImage) -> Floats:
    """Return the range (H, W) in m that an image would have by the map; NaN where the map does not say.

    Key spheres are not blended: small errors of their poses would bring the nearer one to the front everywhere.
    """
    range_m = np.full(one.image.shape, np.nan, np.float32)
    for sphere_id in find_near(base.graph, one):
        placed = PlacedSurface(surface_of(base.load_sphere(sphere_id)), base.graph[sphere_id].T_map_sphere)
        drawn = synthesize([placed], one.T_map_camera, one.camera).range_m
        range_m = np.where(np.isnan(range_m), drawn, range_m)
    return range_m


def find_near(graph: SphereGraph, one: KeyImage) -> list[int]:
    """Return the key spheres that placed an image, then those nearest to it."""
    known = [sphere_id for sphere_id in one.references if sphere_id in graph.nodes]
    near = [node.id for node in graph.nearest(one.T_map_camera.translation, NUM_DRAWN)]
    return list(dict.fromkeys(known + near))


def _edge(graph: SphereGraph, one: KeyImage, node: KeySphere, covariance: Array) -> Edge:
    """Return what was measured between a new key sphere and the one of the map that placed it."""
    origin = graph[find_near(graph, one)[0]]
    T = origin.T_map_sphere.inverse() @ node.T_map_sphere
    return Edge(origin.id, node.id, T, symmetric_inverse(covariance + np.diag(KEY_FLOOR)), is_loop=True)


def examine(
    maps: tuple[Path, Path], withheld: Sequence[KeyImage], others: Sequence[KeptDrive], params: LocalizerParams
) -> tuple[str, bool]:
    """Say how many withheld images both maps explain, and whether the second may take the place of the first."""
    known = known_drives(maps[0])
    before, after = count_explained(maps, withheld, params)
    told = f"explains {after} of {len(_spread(withheld))} withheld images, before {before}"
    if after <= before:
        return told, False
    for drive in others[-MAX_JUDGES:]:
        images = [one for one in drive.images() if one.is_explained or drive.name in known]
        before, after = count_explained(maps, images, params)
        if after < before:
            return f"{told}; {drive.name}: explains {after} of {len(_spread(images))}, before {before}", False
    return f"{told}; {min(len(others), MAX_JUDGES)} other drives as before", True


def count_explained(maps: Sequence[Path], images: Sequence[KeyImage], params: LocalizerParams) -> list[int]:
    """Return how many of some images each map explains, each image by itself; MAX_EXAMINED at most, spread."""
    counts = []
    for path in maps:
        with open_map(path, is_gray=True) as reader:
            localizer = Localizer(params, reader)
            try:
                counts.append(sum(explains(localizer, one) for one in _spread(images)))
            finally:
                localizer.references.close()
    return counts


def explains(localizer: Localizer, one: KeyImage) -> bool:
    """Say whether an image, searched around where it was, is placed there and looks like the map.

    That was told by the map of that day: it is elsewhere where both uncertainties do not explain the distance.
    """
    localizer.reset()
    try:
        localizer.relocalize(one.T_map_camera)
    except ValueError:  # no key sphere near
        return False
    candidate = localizer.update(one.image, one.camera, one.stamp_ns).candidate
    if candidate is None or not candidate.is_accepted or candidate.ncc < MIN_EXPLAINED_NCC:
        return False
    sigma_m = measure_position_sigma(candidate.covariance) + measure_position_sigma(one.covariance)
    return bool(candidate.T_map_camera.distance(one.T_map_camera)[0] <= max(MAX_OFF * sigma_m, MIN_OFF_M))


def _spread(images: Sequence[KeyImage]) -> Sequence[KeyImage]:
    return images[:: -(-len(images) // MAX_EXAMINED) or 1]
