"""The map as it grows, on disk: each key sphere is written when it is kept, and its picture leaves the memory.

The journal is a folder `journal.partial` below the node's map folder (with a number where one is left over): what a
crash leaves is a map that `sphere_nav map-verify --salvage` mends. `save_map` copies it under the name asked for, as
it stands, and the journal goes on; at an orderly end it goes where all of it was saved, else it becomes a map itself.
Where it cannot be written (a full disk) the key spheres stay in memory from there on, and the node maps on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import count
from pathlib import Path

from node_kit.bag_writer import PARTIAL
from node_kit.map_bag import MapDetails, MapWriter
from sphere_map.graph import Edge, KeySphere, SphereGraph
from sphere_map.sphere import Sphere
from sphere_mapping.details_node import details_of
from sphere_mapping.mapper import Mapper
from sphere_mapping.params import SphereMapperParams

NAME = "journal"


class Journal:
    """A store of key spheres (`graph/store.py`) in a map that is being written; made with the first key sphere."""

    def __init__(self, params: SphereMapperParams, tell: Callable[[str], None]) -> None:
        """`tell` is given a line for whom it concerns: where the journal is, and what became of it."""
        self._params, self._tell = params, tell
        self._writer: MapWriter | None = None
        self._unwritten: dict[int, Sphere] = {}
        self._is_saved = self._has_failed = False

    def add(self, node: KeySphere, edges: Sequence[Edge], sphere: Sphere) -> None:
        """Write a key sphere, or keep it in memory where that fails."""
        self._is_saved = False
        if not self._has_failed:
            self._attempt(lambda: self._begun().add(node, edges, sphere))
        if self._has_failed:
            self._unwritten[node.id] = sphere

    def tell(self, graph: SphereGraph) -> None:
        """Write a corrected graph."""
        self._is_saved = False
        if (writer := self._writer) is not None and not self._has_failed:
            self._attempt(lambda: writer.tell(graph))

    def load(self, sphere_id: int) -> Sphere:
        """Read a key sphere back; ValueError where it was not added."""
        if sphere_id in self._unwritten:
            return self._unwritten[sphere_id]
        if self._writer is None:
            raise ValueError(f"key sphere {sphere_id}: expected one that was kept, found none")
        return self._writer.load(sphere_id)

    def saved(self) -> None:
        """Take note that all of it is in a map now."""
        self._is_saved = True

    def close(self, mapper: Mapper) -> None:
        """End an orderly run: what was not saved becomes a map, so that nothing is lost."""
        writer, self._writer = self._writer, None
        if writer is None:
            return
        if self._is_saved:
            writer.discard()
            return
        if self._has_failed:
            self._tell(f"{len(self._unwritten)} key spheres are lost; the others are in {writer.path}{PARTIAL}")
            return
        path = writer.finish(mapper.graph, self._details(mapper.graph), mapper.appearance)
        self._tell(f"{len(mapper.graph)} key spheres were not saved: they are the map {path}")

    def _begun(self) -> MapWriter:
        if self._writer is None:
            self._writer = MapWriter(free_path(Path(self._params.map_folder)), self._details(SphereGraph()))
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
        return details_of(graph, self._params.mapper, frame_id=self._params.map_frame)


def free_path(folder: Path) -> Path:
    """Return a path in a folder, made where it is missing, at which there is neither a map nor the remains of one."""
    folder.mkdir(parents=True, exist_ok=True)
    names = (NAME if number == 1 else f"{NAME}_{number}" for number in count(1))
    paths = (folder / name for name in names)
    return next(path for path in paths if not path.exists() and not path.with_name(path.name + PARTIAL).exists())
