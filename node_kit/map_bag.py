"""A map is a bag: one chunk a key sphere, so that one sphere is one read.

A map is a folder with `map.mcap` and `metadata.yaml`. Topics: `/map/info` (MapInfo, first), `/map/sphere`
(AugmentedSphere, in order of id), `/map/coarse_sphere` (all of them small, in one chunk, for a start),
`/map/graph` (KeySphereGraph, before the spheres and after them; the last one holds).
Everything is checked before it is believed: format version, sizes, checksums, that every vertex has its sphere.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import yaml
from mcap.records import ChunkIndex
from sphere_nav_msgs.msg import AugmentedSphere, KeySphereGraph, MapInfo

from node_kit import qos
from node_kit.bag_error import BagError
from node_kit.bag_reader import BagReader
from node_kit.bag_writer import METADATA, BagWriter
from node_kit.conversions import header, message_to_sphere, sphere_to_message
from node_kit.conversions.graphs import graph_to_message, message_to_graph
from node_kit.files import software
from sphere_geometry.fields import short
from sphere_geometry.yaml_text import load_yaml
from sphere_map.coarse import coarse_sphere
from sphere_map.graph import KeySphere, SphereGraph
from sphere_map.sphere import Sphere

FILE_NAME = "map.mcap"
INFO, SPHERE, GRAPH, COARSE = "/map/info", "/map/sphere", "/map/graph", "/map/coarse_sphere"
KINDS: dict[str, type[Any]] = {INFO: MapInfo, SPHERE: AugmentedSphere, GRAPH: KeySphereGraph, COARSE: AugmentedSphere}
MAP_FRAME, SPHERE_FRAME = "map", "sphere_link"
ONE_CHUNK = 1 << 40  # bytes: chunks end where we say
MAX_SPHERES = 10_000_000

Progress = Callable[[int], None]


@dataclass(frozen=True)
class MapDetails:
    """What a map says about itself."""

    map_id: str = ""
    software: str = dataclasses.field(default_factory=software)
    source: str = ""
    parameters: Mapping[str, Any] | None = None
    rig: str = ""
    frame_id: str = MAP_FRAME


def save_map(
    path: str | Path,
    graph: SphereGraph,
    details: MapDetails | None = None,
    *,
    load_sphere: Callable[[int], Sphere] | None = None,
    is_overwriting: bool = False,
    image_encoding: str = AugmentedSphere.PNG,
    progress: Progress = lambda step: None,
) -> Path:
    """Write a map; it appears under its name only when it is complete. `load_sphere` gives spheres not in memory."""
    details, path = details or MapDetails(), Path(path)
    if not len(graph):
        raise BagError(f"{path}: expected a graph with key spheres, found an empty one")
    if path.exists() and (not is_overwriting or not (path / FILE_NAME).is_file()):
        raise BagError(f"{path}: expected no such file or folder, found one: nothing is overwritten")
    target = path.with_name(f"{path.name}.new") if path.exists() else path
    nodes, coarse = sorted(graph, key=lambda node: node.id), []
    with BagWriter(target, file_name=FILE_NAME, chunk_size=ONE_CHUNK) as bag:
        for topic, kind in KINDS.items():
            bag.add_topic(topic, kind, qos.LATCHED)
        bag.write(INFO, _info(graph, details), nodes[0].stamp_ns)
        bag.write(GRAPH, _graph_message(graph, details), nodes[0].stamp_ns)  # so that a torn file can be salvaged
        for node in nodes:
            bag.end_chunk()
            sphere = node.sphere or (load_sphere(node.id) if load_sphere else None)
            if sphere is None:
                raise BagError(f"{path}: key sphere {node.id}: expected its picture in memory, found none")
            message = sphere_to_message(sphere, SPHERE_FRAME, node.id, image_encoding=image_encoding)
            bag.write(SPHERE, message, node.stamp_ns)
            coarse.append(sphere_to_message(coarse_sphere(sphere), SPHERE_FRAME, node.id))
            progress(1)
        bag.end_chunk()
        for node, message in zip(nodes, coarse, strict=True):
            bag.write(COARSE, message, node.stamp_ns)
        bag.end_chunk()
        last = max(node.stamp_ns for node in nodes)
        bag.write(GRAPH, _graph_message(graph, details), last)
    return _replace(target, path) if target != path else path


def open_map(path: str | Path) -> MapReader:
    """Open a map; BagError in one line for whatever is wrong with it."""
    return MapReader(path)


class MapReader:
    """An open map: the graph is read at once, spheres when they are asked for.

    `graph` (without pictures), `info` (MapInfo), `parameters` of the mapping by dotted name.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        file = self.path / FILE_NAME if self.path.is_dir() else self.path
        if self.path.is_dir() and not file.is_file():
            raise BagError(f"{file}: expected a map, found no such file")
        self._bag = BagReader(file)
        try:
            self.info = self._read_info()
            self.graph = self._read_graph()
            self.parameters = self._read_parameters()
            self._chunks = self._find_spheres()
        except BaseException:
            self._bag.close()
            raise

    def load_sphere(self, sphere_id: int) -> Sphere:
        """Read one key sphere, one chunk; BagError if it is missing or damaged."""
        index = self._chunks.get(sphere_id)
        if index is None:
            raise BagError(
                f"{self.path}: key sphere {sphere_id}: expected one of the map's {len(self.graph)}, found none"
            )
        message = self._message_of(index)
        if message.id != sphere_id:
            raise BagError(
                f"{self.path}: chunk {index.chunk_start_offset}: expected sphere {sphere_id}, found {message.id}"
            )
        try:
            sphere = message_to_sphere(message)
        except ValueError as error:
            raise BagError(f"{self.path}: key sphere {sphere_id}: {error}") from None
        return sphere

    def coarse_spheres(self) -> dict[int, Sphere]:
        """Read all key spheres small, in one read; made from the spheres themselves where a map has none.

        BagError if one is missing or damaged.
        """
        if not self._bag.topics.get(COARSE):
            return {node.id: coarse_sphere(self.load_sphere(node.id)) for node in self.graph}
        found = {}
        for _, _, message in self._bag.messages([COARSE]):
            try:
                found[int(message.id)] = message_to_sphere(message)
            except ValueError as error:
                raise BagError(f"{self.path}: coarse sphere {message.id}: {error}") from None
        if found.keys() != self.graph.nodes.keys():
            raise BagError(f"{self.path}: coarse spheres: expected one for each of {len(self.graph)} key spheres")
        return found

    def load_all(self, progress: Progress = lambda step: None) -> SphereGraph:
        """Return the graph with every picture in memory."""
        nodes = []
        for node in self.graph:
            nodes.append(replace(node, sphere=self.load_sphere(node.id)))
            progress(1)
        return SphereGraph(nodes, self.graph.edges)

    def close(self) -> None:
        """Close the file."""
        self._bag.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        self.close()

    def _read_info(self) -> MapInfo:
        self._bag.require(INFO, MapInfo)
        info: MapInfo = next(self._bag.messages([INFO])).message
        if info.format_version != MapInfo.FORMAT_VERSION:
            found = info.format_version
            raise BagError(f"{self.path}: format_version: expected {MapInfo.FORMAT_VERSION}, found {found}")
        if info.num_spheres > MAX_SPHERES:
            raise BagError(f"{self.path}: num_spheres: expected at most {MAX_SPHERES}, found {info.num_spheres}")
        return info

    def _read_graph(self) -> SphereGraph:
        self._bag.require(GRAPH, KeySphereGraph)
        message = list(self._bag.messages([GRAPH]))[-1].message
        if message.format_version != MapInfo.FORMAT_VERSION:
            found = message.format_version
            raise BagError(f"{self.path}: graph format_version: expected {MapInfo.FORMAT_VERSION}, found {found}")
        try:
            graph = message_to_graph(message)
        except ValueError as error:
            raise BagError(f"{self.path}: graph: {error}") from None
        if not len(graph):
            raise BagError(f"{self.path}: graph: expected key spheres, found none")
        if len(graph) != self.info.num_spheres:
            raise BagError(f"{self.path}: graph: expected {self.info.num_spheres} vertices (info), found {len(graph)}")
        return graph

    def _read_parameters(self) -> dict[str, Any]:
        try:
            values = load_yaml(f"{self.path}: parameters", self.info.parameters) or {}
        except ValueError as error:
            raise BagError(str(error)) from None
        if not isinstance(values, dict):
            raise BagError(f"{self.path}: parameters: expected YAML of names and values, found {short(values)}")
        return values

    def _find_spheres(self) -> dict[int, ChunkIndex]:
        """Return the chunk of every key sphere: spheres are stored in order of id, one a chunk."""
        self._bag.require(SPHERE, AugmentedSphere)
        file = self._bag.files[0]
        channels = {channel.id for channel in file.summary.channels.values() if channel.topic == SPHERE}
        chunks = [index for index in file.summary.chunk_indexes if channels & index.message_index_offsets.keys()]
        chunks.sort(key=lambda index: index.chunk_start_offset)
        ids = sorted(node.id for node in self.graph)
        found = self._bag.topics[SPHERE].count
        if len(chunks) != len(ids) or found != len(ids):
            raise BagError(f"{self.path}: spheres: expected {len(ids)} (one a vertex of the graph), found {found}")
        return dict(zip(ids, chunks, strict=True))

    def _message_of(self, index: ChunkIndex) -> AugmentedSphere:
        file = self._bag.files[0]
        found = [message for channel, message in file.chunk(index) if channel.topic == SPHERE]
        if len(found) != 1:
            raise BagError(f"{self.path}: chunk {index.chunk_start_offset}: expected one sphere, found {len(found)}")
        message: AugmentedSphere = self._bag.decode(SPHERE, found[0].data, AugmentedSphere)
        return message


def _info(graph: SphereGraph, details: MapDetails) -> MapInfo:
    nodes = sorted(graph, key=lambda node: node.id)
    return MapInfo(
        header=header(nodes[0].stamp_ns, details.frame_id),
        map_id=details.map_id,
        format_version=MapInfo.FORMAT_VERSION,
        software=details.software,
        source=details.source,
        parameters=yaml.safe_dump(dict(details.parameters or {}), sort_keys=False),
        rig=details.rig,
        num_spheres=len(nodes),
        length=_length(nodes),
    )


def _graph_message(graph: SphereGraph, details: MapDetails) -> KeySphereGraph:
    return graph_to_message(graph, details.frame_id, map_id=details.map_id, software=details.software)


def _length(nodes: list[KeySphere]) -> float:
    steps = pairwise(nodes)
    return float(sum(first.T_map_sphere.distance(second.T_map_sphere)[0] for first, second in steps))


def _replace(new: Path, path: Path) -> Path:
    """Put a complete map in the place of an old one; other files in its folder stay.

    Each file takes the place of the old one at once, the map first: whatever happens in between, there is a whole map.
    """
    for name in (FILE_NAME, METADATA):
        (new / name).replace(path / name)
    new.rmdir()
    return path
