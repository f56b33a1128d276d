"""A map is a bag: one chunk a key sphere, so that one sphere is one read.

A map is a folder with `map.mcap` and `metadata.yaml`. Topics: `/map/info` (MapInfo, the last one holds), `/map/sphere`
(AugmentedSphere, in order of id), `/map/coarse_sphere` and `/map/features` (all of them small, and what they look
like, PointCloud2 in order of id, in chunks of their own, for a start),
`/map/graph` (KeySphereGraph, the last one holds), `/map/experience` (MapExperience, one a drive; may be missing).
Everything is checked before it is believed: format version, sizes, checksums, that every vertex has its sphere.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

from mcap.records import ChunkIndex
from sensor_msgs.msg import PointCloud2
from sphere_nav_msgs.msg import AugmentedSphere, KeySphereGraph, MapExperience, MapInfo

from sphere_nav.geometry import SE3
from sphere_nav.geometry.files.untrusted import load_yaml, short, told_at
from sphere_nav.ros.bags.mcap_file import McapFile, read_message
from sphere_nav.ros.bags.reader import BagReader
from sphere_nav.ros.bags.recorded import BagError, view_message
from sphere_nav.ros.camera.mounting import parse_mounting
from sphere_nav.ros.conversions import message_to_sphere
from sphere_nav.ros.conversions.clouds import message_to_features
from sphere_nav.ros.conversions.graphs import message_to_graph, messages_to_experiences
from sphere_nav.ros.maps.compact import CompactFeatures, CompactSpheres
from sphere_nav.ros.maps.writer import COARSE, EXPERIENCE, FEATURES, GRAPH, INFO, SPHERE, Stored
from sphere_nav.ros.maps.writer import FILE_NAME as FILE_NAME
from sphere_nav.ros.maps.writer import ORIGIN as ORIGIN
from sphere_nav.ros.maps.writer import SPHERE_ON_BASE as SPHERE_ON_BASE
from sphere_nav.ros.maps.writer import MapDetails as MapDetails
from sphere_nav.ros.maps.writer import MapWriter as MapWriter
from sphere_nav.ros.maps.writer import save_map as save_map
from sphere_nav.spheres.appearance.index import AppearanceIndex
from sphere_nav.spheres.graph import SphereGraph
from sphere_nav.spheres.sphere import Sphere


class MapReader(BagReader):
    """An open map: the graph is read at once, spheres when they are asked for.

    `graph` (without pictures), `info` (MapInfo), `parameters` of the mapping by dotted name. Key spheres are read
    `is_gray` for alignment. BagError for whatever is wrong with it.
    """

    def __init__(self, path: str | Path, *, is_gray: bool = False) -> None:
        folder = Path(path)
        file = folder / FILE_NAME if folder.is_dir() else folder
        if folder.is_dir() and not file.is_file():
            raise BagError(f"{file}: expected a map, found no such file")
        self._is_gray = is_gray
        super().__init__(file)
        self.path = folder

    def _open(self) -> None:
        super()._open()
        if not isinstance(self.files[0], McapFile):
            raise BagError(f"{self.path}: expected a map with an index, found none")
        self.info = self._read_info()
        self.graph = self._read_graph()
        self.parameters = self._read_parameters()
        self._chunks = self._find_spheres()

    def load_sphere(self, sphere_id: int) -> Sphere:
        """Read one key sphere, one chunk; BagError if it is missing or damaged."""
        message = view_message(self._data_of(sphere_id), AugmentedSphere, f"{self.path}: {SPHERE}")
        if message.id != sphere_id:
            raise BagError(f"{self.path}: {SPHERE}: expected sphere {sphere_id}, found {message.id}")
        with told_at(f"{self.path}: key sphere {sphere_id}", BagError):
            return message_to_sphere(message, is_gray=self._is_gray)

    def coarse_spheres(self) -> Mapping[int, Sphere]:
        """Read all key spheres small, in one read; they wait on the disk. BagError if one is missing or damaged."""
        found = CompactSpheres()
        self.require(COARSE, AugmentedSphere)
        for number, item in enumerate(self.raw([COARSE])):
            with told_at(f"{self.path}: coarse sphere {number} of {len(self.graph)}", BagError):
                found.keep(item.message)
        if found.keys() != self.graph.nodes.keys():
            raise BagError(f"{self.path}: coarse spheres: expected one for each of {len(self.graph)} key spheres")
        return found

    def stored(self) -> Iterator[Stored]:
        """Yield the messages of all key spheres, whole and small, in order of their ids. BagError for damage."""
        for sphere_id, small in zip(self._chunks, self.messages([COARSE]), strict=True):
            yield self.decode(SPHERE, bytes(self._data_of(sphere_id)), AugmentedSphere), small.message

    def appearance(self) -> AppearanceIndex:
        """Read what all key spheres look like, in one read; the features wait on the disk. BagError for damage."""
        index, ids = AppearanceIndex(CompactFeatures()), sorted(self.graph.nodes)
        if self.require(FEATURES, PointCloud2).count != len(ids):
            raise BagError(f"{self.path}: features: expected those of each of {len(ids)} key spheres, found others")
        for sphere_id, item in zip(ids, self.raw([FEATURES]), strict=True):
            with told_at(f"{self.path}: features of key sphere {sphere_id}", BagError):
                message = view_message(memoryview(item.message), PointCloud2, FEATURES)
                index.add(sphere_id, *message_to_features(message))
        return index

    @property
    def origin(self) -> str:
        """What fixes the frame of the map, in words; a map that does not say so has that of its first sphere."""
        return str(self.parameters.get(ORIGIN) or "the first sphere")

    @cached_property
    def T_base_sphere(self) -> SE3 | None:
        """The spheres of the first drive on its vehicle; None where the map does not say it. BagError for nonsense."""
        values = self.parameters.get(SPHERE_ON_BASE)
        with told_at(self.path, BagError):
            return None if values is None else parse_mounting(values, SPHERE_ON_BASE)

    def _read_info(self) -> MapInfo:
        self.require(INFO, MapInfo)
        info: MapInfo = list(self.messages([INFO]))[-1].message
        if info.format_version != MapInfo.FORMAT_VERSION:
            found = info.format_version
            raise BagError(f"{self.path}: format_version: expected {MapInfo.FORMAT_VERSION}, found {found}")
        return info

    def _read_graph(self) -> SphereGraph:
        self.require(GRAPH, KeySphereGraph)
        message = list(self.messages([GRAPH]))[-1].message
        if EXPERIENCE in self.topics and self.topics[EXPERIENCE].count:
            self.require(EXPERIENCE, MapExperience)
        told = [item.message for item in self.messages([EXPERIENCE])]
        with told_at(f"{self.path}: graph", BagError):
            graph = messages_to_experiences(message_to_graph(message), told)
        if not len(graph):
            raise BagError(f"{self.path}: graph: expected key spheres, found none")
        if len(graph) != self.info.num_spheres:
            raise BagError(f"{self.path}: graph: expected {self.info.num_spheres} vertices (info), found {len(graph)}")
        return graph

    def _read_parameters(self) -> dict[str, Any]:
        with told_at(self.path, BagError):
            values = load_yaml("parameters", self.info.parameters) or {}
        if not isinstance(values, dict):
            raise BagError(f"{self.path}: parameters: expected YAML of names and values, found {short(values)}")
        return values

    def _find_spheres(self) -> dict[int, ChunkIndex]:
        """Return the chunk of every key sphere: spheres are stored in order of id, one a chunk."""
        self.require(SPHERE, AugmentedSphere)
        file = self.files[0]
        channels = {channel.id for channel in file.summary.channels.values() if channel.topic == SPHERE}
        chunks = [index for index in file.summary.chunk_indexes if channels & index.message_index_offsets.keys()]
        chunks.sort(key=lambda index: index.chunk_start_offset)
        ids = sorted(node.id for node in self.graph)
        found = self.topics[SPHERE].count
        if len(chunks) != len(ids) or found != len(ids):
            raise BagError(f"{self.path}: spheres: expected {len(ids)} (one a vertex of the graph), found {found}")
        return dict(zip(ids, chunks, strict=True))

    def _data_of(self, sphere_id: int) -> memoryview:
        """Return the bytes of the message of a key sphere."""
        if sphere_id not in self._chunks:
            raise BagError(
                f"{self.path}: key sphere {sphere_id}: expected one of the map's {len(self.graph)}, found none"
            )
        place = self._chunks[sphere_id].chunk_start_offset
        with told_at(f"{self.path}: chunk at byte {place}", BagError):
            return read_message(self.files[0].stream, place)


open_map = MapReader
