"""The map on disk: the journal as it grows, and the service `save_map`.

Each key sphere is written to the journal when it is kept, and leaves the memory. The journal is a folder
`journal.partial` below the node's map folder (with a number where one is left over): what a crash leaves is a map that
`sphere_nav map-verify --salvage` mends. `save_map` copies it under the name asked for, as it stands, and the journal
goes on; at an orderly end it goes where all of it was saved, else it becomes a map itself. Where it cannot be written
(a full disk) the key spheres stay in memory from there on, and the node maps on; the end of it tries once more.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from sphere_nav_msgs.srv import SaveMap

from sphere_mapping.graph.merging import merge
from sphere_mapping.mapper import Mapper
from sphere_mapping.params import MapperParams, SphereMapperParams
from sphere_nav.geometry import SE3
from sphere_nav.geometry.files.untrusted import path_below
from sphere_nav.params import to_mapping
from sphere_nav.ros.bags.writer import PARTIAL, free_path
from sphere_nav.ros.maps.reader import ORIGIN, SPHERE_ON_BASE, MapDetails, MapWriter, save_map
from sphere_nav.spheres.graph import KeySphere, SphereGraph
from sphere_nav.spheres.sphere import Sphere


def details_of(
    graph: SphereGraph,
    params: MapperParams,
    source: str = "",
    frame_id: str = "map",
    rig: str = "",
    frame: tuple[str, SE3 | None] = ("", None),
) -> MapDetails:
    """Return what a map says about itself; its id is a checksum of stamps and poses.

    frame: what fixes its origin, in words, and its first drive's spheres on the vehicle (T_base_sphere; None: untold).
    """
    origin, T_base_sphere = frame
    digest = hashlib.sha256()
    for node in graph:
        digest.update(node.stamp_ns.to_bytes(8, "little", signed=True) + node.T_map_sphere.matrix.tobytes())
    map_id, parameters = digest.hexdigest()[:16], {ORIGIN: origin} | to_mapping(params)
    if T_base_sphere is not None:
        place = *T_base_sphere.translation.tolist(), *map(float, T_base_sphere.angles)
        parameters[SPHERE_ON_BASE] = [round(one, 6) for one in place]
    return MapDetails(map_id, source=source, parameters=parameters, rig=rig, frame_id=frame_id)


NAME = "journal"


class Journal:
    """A store of key spheres (`graph/store.py`) in a map that is being written; made with the first key sphere."""

    def __init__(self, params: SphereMapperParams, tell: Callable[[str], None]) -> None:
        """`tell` is given a line for whom it concerns: where the journal is, and what became of it."""
        self._params, self._tell = params, tell
        self.frame: tuple[str, SE3 | None] = "", None
        self._writer: MapWriter | None = None
        self._unwritten: dict[int, Sphere] = {}
        self.is_saved = self._has_failed = False  # whether all of it is in a map; it could not be written

    def add(self, node: KeySphere, sphere: Sphere) -> None:
        """Write a key sphere, or keep it in memory where that fails."""
        self.is_saved = False
        if not self._has_failed:
            self._attempt(lambda: self._begun().add(node, sphere))
        if self._has_failed:
            self._unwritten[node.id] = sphere

    def tell(self, graph: SphereGraph) -> None:
        """Write the graph as it is now."""
        self.is_saved = False
        if not self._has_failed:
            self._attempt(lambda: self._begun().tell(graph))

    def load(self, sphere_id: int) -> Sphere:
        """Read a key sphere back; ValueError where it was not added."""
        if sphere_id in self._unwritten:
            return self._unwritten[sphere_id]
        if self._writer is None:
            raise ValueError(f"key sphere {sphere_id}: expected one that was kept, found none")
        return self._writer.load(sphere_id)

    def close(self, mapper: Mapper) -> None:
        """End an orderly run: what was not saved becomes a map, so that nothing is lost."""
        writer, graph = self._writer, mapper.graph
        if (writer is None and not self._unwritten) or self.is_saved:
            if writer is not None:
                writer.discard()
            return
        try:
            path = self._finish(writer, mapper)
        except (OSError, ValueError) as error:
            kept = f"; the others are in {writer.path}{PARTIAL}" if writer is not None else ""
            self._tell(f"{error}: {len(self._unwritten)} key spheres are lost{kept}")
            return
        self._tell(f"{len(graph)} key spheres were not saved: they are the map {path}")

    def _finish(self, writer: MapWriter | None, mapper: Mapper) -> Path:
        """Complete the journal, or write it anew where it could not take all: there may be space again."""
        graph, seen = mapper.graph, mapper.appearance
        if writer is not None and not self._has_failed:
            try:
                return writer.finish(graph, self._details(graph), seen)
            finally:
                writer.leave()
        path = journal_path(Path(self._params.map_folder))
        save_map(path, graph, self._details(graph), load_sphere=self.load, appearance=seen)
        if writer is not None:
            writer.discard()
        return path

    def _begun(self) -> MapWriter:
        if self._writer is None:
            self._writer = MapWriter(journal_path(Path(self._params.map_folder)), self._details(SphereGraph()))
            self._tell(f"key spheres are written to {self._writer.path}{PARTIAL} until save_map")
        return self._writer

    def _attempt(self, write: Callable[[], None]) -> None:
        """Write; say once where that fails."""
        try:
            write()
        except OSError as error:
            self._has_failed = True
            self._tell(
                f"map_folder {self._params.map_folder}: {error}: key spheres stay in memory; free space, save_map"
            )

    def _details(self, graph: SphereGraph) -> MapDetails:
        return details_of(graph, self._params.mapper, frame_id=self._params.map_frame, frame=self.frame)


def journal_path(folder: Path) -> Path:
    """Return a path in a folder, made where it is missing, at which there is neither a map nor the remains of one."""
    folder.mkdir(parents=True, exist_ok=True)
    return free_path(folder / NAME)


def save(
    mapper: Mapper,
    params: SphereMapperParams,
    request: SaveMap.Request,
    response: SaveMap.Response,
    journal: Journal | None = None,
) -> SaveMap.Response:
    """Write the map built so far, its newest sphere included; say where, how large, and how long it took."""
    begin = time.monotonic()
    mapper.keep_end()
    path = path_below(Path(params.map_folder), request.path, "a folder (parameter map_folder)")
    path.parent.mkdir(parents=True, exist_ok=True)
    graph = graph_to_save(mapper)
    frame = mapper.origin, mapper.T_base_sphere
    details = details_of(graph, params.mapper, frame_id=params.map_frame, frame=frame)
    load, seen, is_overwriting = mapper.load_sphere, mapper.appearance, request.overwrite
    save_map(path, graph, details, load_sphere=load, appearance=seen, is_overwriting=is_overwriting)
    if journal is not None:
        journal.is_saved = True
    response.success, response.path, response.num_spheres = True, str(path), len(graph)
    response.message = f"{len(graph)} key spheres"
    response.num_bytes = sum(file.stat().st_size for file in path.iterdir())
    response.seconds = time.monotonic() - begin
    return response


def graph_to_save(mapper: Mapper) -> SphereGraph:
    """Return the graph without the key spheres of places that others show as well; the mapper keeps them all."""
    if not mapper.params.key.merge:
        return mapper.graph
    return merge(mapper.graph, np.array([pose.translation for _, pose in mapper.trajectory()]))
