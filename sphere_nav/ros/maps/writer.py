"""Write a map: all at once, or one key sphere after the other as they are kept.

What `reader.py` reads. While a map grows, the graph is written again every few key spheres, so that a process killed
at any moment leaves a map up to its last graph: `salvage_map` gives it an index.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any

import yaml
from sensor_msgs.msg import PointCloud2
from sphere_nav_msgs.msg import AugmentedSphere, KeySphereGraph, MapExperience, MapInfo

from sphere_nav.ros import qos
from sphere_nav.ros.bags.mcap_file import read_message
from sphere_nav.ros.bags.recorded import BagError, view_message
from sphere_nav.ros.bags.writer import METADATA, BagWriter
from sphere_nav.ros.conversions import header, message_to_sphere, sphere_to_message, stamp_ns
from sphere_nav.ros.conversions.clouds import features_to_message
from sphere_nav.ros.conversions.graphs import experiences_to_messages, graph_to_message
from sphere_nav.ros.conversions.status import told
from sphere_nav.ros.shared_files import software
from sphere_nav.spheres.appearance.features import features_of_sphere
from sphere_nav.spheres.appearance.index import AppearanceIndex
from sphere_nav.spheres.coarse import coarse_sphere
from sphere_nav.spheres.graph import Experience, KeySphere, SphereGraph
from sphere_nav.spheres.sphere import Sphere

FILE_NAME = "map.mcap"
INFO, SPHERE, GRAPH = "/map/info", "/map/sphere", "/map/graph"
COARSE, FEATURES = "/map/coarse_sphere", "/map/features"
EXPERIENCE = "/map/experience"
KINDS: dict[str, type[Any]] = {
    INFO: MapInfo,
    SPHERE: AugmentedSphere,
    GRAPH: KeySphereGraph,
    COARSE: AugmentedSphere,
    FEATURES: PointCloud2,
    EXPERIENCE: MapExperience,
}
MAP_FRAME, SPHERE_FRAME = "map", "sphere_link"
ORIGIN = "origin"  # among the parameters: what fixes the frame of the map, in words
SPHERE_ON_BASE = "sphere_on_base"  # the same: x, y, z, roll, pitch, yaw (m, rad) of the first drive's spheres
CHUNK_SIZE = 1 << 24  # bytes of a chunk of small spheres or features; a sphere is one, whatever it takes
GRAPH_EVERY = 4  # key spheres, after which the graph is written again: as many less one are lost in a crash

Progress = Callable[[int], None]
Stored = tuple[AugmentedSphere, AugmentedSphere]  # a key sphere, whole and small


def as_stored(sphere_id: int, sphere: Sphere) -> Stored:
    """Return the messages of a key sphere, whole and small."""
    whole = sphere_to_message(sphere, SPHERE_FRAME, sphere_id, is_png=True)
    return whole, sphere_to_message(coarse_sphere(sphere), SPHERE_FRAME, sphere_id)


@dataclass(frozen=True)
class MapDetails:
    """What a map says about itself."""

    map_id: str = ""
    software: str = dataclasses.field(default_factory=software)
    source: str = ""
    parameters: Mapping[str, Any] | None = None
    rig: str = ""
    frame_id: str = MAP_FRAME


class MapWriter(BagWriter):
    """A map being written; until `finish` it is the folder `<path>.partial`, which `salvage_map` can read.

    One that takes the place of another is written beside it first, as `<path>.new`.
    Key spheres are added in order of their ids; each is in the system's hands when `add` returns, and can be read back.
    """

    def __init__(
        self,
        path: str | Path,
        details: MapDetails | None = None,
        *,
        is_overwriting: bool = False,
    ) -> None:
        self._target, self.details = Path(path), details or MapDetails()
        self._places: dict[int, int] = {}  # of the chunk of each sphere
        self._num_due = 0  # key spheres with which the graph is due
        check_free(self._target, is_overwriting=is_overwriting)
        new = self._target.with_name(f"{self._target.name}.new") if self._target.exists() else self._target
        super().__init__(new, file_name=FILE_NAME, chunk_size=CHUNK_SIZE)
        for topic, kind in KINDS.items():
            self.add_topic(topic, kind, qos.LATCHED)
        self._latest_ns = 0  # of the spheres: bags give the small ones in order of the ids

    def add(self, node: KeySphere, sphere: Sphere) -> None:
        """Write a key sphere."""
        self.copy(as_stored(node.id, sphere))

    def tell(self, graph: SphereGraph) -> None:
        """Write the graph as it is now, with every few key spheres."""
        if len(graph) < self._num_due:
            return
        if not self._num_due:
            self.write(INFO, _info(graph, self.details), min(node.stamp_ns for node in graph))
        self._num_due = len(graph) + GRAPH_EVERY
        self.write(GRAPH, _graph_message(graph, self.details), max(node.stamp_ns for node in graph))
        if any(node.experience != Experience() for node in graph):
            self._tell_experiences(graph)  # so that a torn map has them
        self.flush()

    def load(self, sphere_id: int) -> Sphere:
        """Read a key sphere back; BagError where it was not added."""
        if sphere_id not in self._places:
            raise BagError(f"{self.path}: key sphere {sphere_id}: expected one that was written, found none")
        folder = self.partial if self.partial.exists() else self.path
        with (folder / FILE_NAME).open("rb") as file:
            data = read_message(file, self._places[sphere_id])
        return message_to_sphere(view_message(data, AugmentedSphere, str(self.path)))

    def copy(self, stored: Stored) -> None:
        """Write a key sphere as another map has it."""
        whole, small = stored
        self.flush()
        self._places[int(whole.id)] = self.position
        self._latest_ns = max(self._latest_ns, stamp_ns(whole))
        self.write(SPHERE, whole, stamp_ns(whole))
        self.flush()
        self.write(COARSE, small, self._latest_ns)
        self.flush()

    @property
    def num_spheres(self) -> int:
        """Key spheres that were written."""
        return len(self._places)

    def finish(
        self, graph: SphereGraph, details: MapDetails | None = None, appearance: AppearanceIndex | None = None
    ) -> Path:
        """Complete the map with the graph that holds, of the spheres that were added; return its path."""
        self.details = details or self.details
        nodes = sorted(graph, key=lambda node: node.id)
        if [node.id for node in nodes] != list(self._places):
            found = f"found {len(self._places)} written"
            raise BagError(f"{self.path}: graph: expected {len(nodes)} key spheres, {found}")
        self._write_features(nodes, appearance)
        self.flush()
        last = max(node.stamp_ns for node in nodes)
        self._tell_experiences(graph)
        self.write(INFO, _info(graph, self.details), last)
        self.write(GRAPH, _graph_message(graph, self.details), last)
        if self.close() != self._target:
            self.path = replace_map(self.path, self._target)
        return self.path

    @property
    def salvage_command(self) -> str:
        """The command that makes a map of what is whole."""
        return f"sphere_nav map-verify {self.partial} --salvage OUT"

    def _tell_experiences(self, graph: SphereGraph) -> None:
        for message in experiences_to_messages(graph, self.details.frame_id):
            self.write(EXPERIENCE, message, max(node.stamp_ns for node in graph))

    def _write_features(self, nodes: Sequence[KeySphere], appearance: AppearanceIndex | None) -> None:
        known = appearance.features if appearance is not None else {}
        index = AppearanceIndex()
        stamps = accumulate((node.stamp_ns for node in nodes), max)  # in order of the ids, as those of `copy`
        for node, stamp in zip(nodes, stamps, strict=True):
            index.add(node.id, known.get(node.id) or features_of_sphere(self.load(node.id)))
            features, words = index.features[node.id], index.words[node.id]
            message = features_to_message(features, words, node.stamp_ns, SPHERE_FRAME)
            self.write(FEATURES, message, stamp)


def save_map(
    path: str | Path,
    graph: SphereGraph,
    details: MapDetails | None = None,
    *,
    load_sphere: Callable[[int], Sphere] | None = None,
    appearance: AppearanceIndex | None = None,
    is_overwriting: bool = False,
) -> Path:
    """Write a map; it appears under its name only when it is complete.

    `load_sphere` gives spheres that are not in memory, `appearance` what some of them look like where that is known.
    """
    if not len(graph):
        raise BagError(f"{path}: expected a graph with key spheres, found an empty one")

    def stored() -> Iterator[Stored]:
        for node in sorted(graph, key=lambda node: node.id):
            sphere = node.sphere or (load_sphere(node.id) if load_sphere else None)
            if sphere is None:
                raise BagError(f"{path}: key sphere {node.id}: expected its picture in memory, found none")
            yield as_stored(node.id, sphere)

    return write_stored(Path(path), graph, details, appearance, stored(), is_overwriting=is_overwriting)


def write_stored(
    path: Path,
    graph: SphereGraph,
    details: MapDetails | None,
    appearance: AppearanceIndex | None,
    spheres: Iterable[Stored],
    *,
    is_overwriting: bool = False,
) -> Path:
    """Write a map of those of some key spheres, in order of their ids, that are in the graph; return its path."""
    with MapWriter(path, details, is_overwriting=is_overwriting) as writer:
        writer.tell(graph)  # so that a torn file can be salvaged
        for stored in spheres:
            if int(stored[0].id) in graph.nodes:
                writer.copy(stored)
        return writer.finish(graph, appearance=appearance)


def check_free(path: Path, *, is_overwriting: bool) -> None:
    """Raise BagError where something is in the place of a map that may not be replaced."""
    is_map = (path / FILE_NAME).is_file()
    if path.exists() and not (is_overwriting and is_map):
        found = "a map: nothing is overwritten without --overwrite" if is_map else "one: nothing is overwritten"
        raise BagError(f"{path}: expected no such file or folder, found {found}")


def _info(graph: SphereGraph, details: MapDetails) -> MapInfo:
    nodes = sorted(graph, key=lambda node: node.id)
    steps = (first.T_map_sphere.distance(second.T_map_sphere)[0] for first, second in pairwise(nodes))
    info = MapInfo(
        header=header(nodes[0].stamp_ns, details.frame_id),
        format_version=MapInfo.FORMAT_VERSION,
        parameters=yaml.safe_dump(dict(details.parameters or {}), sort_keys=False),
        num_spheres=len(nodes),
        length=float(sum(steps)),
    )
    return told(info, details, "map_id", "software", "source", "rig")


def _graph_message(graph: SphereGraph, details: MapDetails) -> KeySphereGraph:
    return graph_to_message(graph, details.frame_id, map_id=details.map_id, software=details.software)


def replace_map(new: Path, path: Path) -> Path:
    """Put a complete map in the place of an old one; other files in its folder stay.

    Each file takes the place of the old one at once, the map first: whatever happens in between, there is a whole map.
    """
    for name in (FILE_NAME, METADATA):
        (new / name).replace(path / name)
    new.rmdir()
    return path
