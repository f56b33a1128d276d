"""The service `save_map`: the map built so far as a folder below the node's map folder."""

from __future__ import annotations

import hashlib
import time
from pathlib import Path

from sphere_nav_msgs.srv import SaveMap

from node_kit.map_bag import MapDetails, save_map
from node_kit.node import ManagedNode
from sphere_map.graph import SphereGraph
from sphere_mapping.mapper import Mapper
from sphere_mapping.params import MapperParams, SphereMapperParams
from typed_params import to_mapping


class MapSaver:
    """Serves `save_map`."""

    def __init__(self, node: ManagedNode, params: SphereMapperParams) -> None:
        self._node, self._params = node, params
        node.add_service("save_map", SaveMap, self._on_save)

    def _on_save(self, request: SaveMap.Request, response: SaveMap.Response) -> SaveMap.Response:
        begin = time.monotonic()
        mapper: Mapper = self._node.mapper  # type: ignore[attr-defined]
        mapper.keep_end()
        graph = mapper.graph
        try:
            path = inside(Path(self._params.map_folder), request.path)
            path.parent.mkdir(parents=True, exist_ok=True)
            details = details_of(graph, self._params.mapper, frame_id=self._params.map_frame)
            save_map(path, graph, details, is_overwriting=request.overwrite)
        except (ValueError, OSError) as error:
            response.success, response.message = False, str(error)
            return response
        response.success, response.path, response.num_spheres = True, str(path), len(graph)
        response.message = f"{len(graph)} key spheres"
        response.num_bytes = sum(file.stat().st_size for file in path.iterdir())
        response.seconds = time.monotonic() - begin
        return response


def inside(folder: Path, name: str) -> Path:
    """Return the path of a map; ValueError unless it lies below the folder."""
    root = folder.resolve()
    path = (root / name).resolve()
    if not name or path == root or not path.is_relative_to(root):
        raise ValueError(f"path: expected a folder below {root} (parameter map_folder), found {name!r}")
    return path


def details_of(graph: SphereGraph, params: MapperParams, source: str = "", frame_id: str = "map") -> MapDetails:
    """Return what a map says about itself; its id is a checksum of stamps and poses."""
    digest = hashlib.sha256()
    for node in graph:
        digest.update(node.stamp_ns.to_bytes(8, "little", signed=True) + node.T_map_sphere.matrix.tobytes())
    return MapDetails(digest.hexdigest()[:16], source=source, parameters=to_mapping(params), frame_id=frame_id)
