"""The service `save_map`: the map built so far as a folder below the node's map folder."""

from __future__ import annotations

import hashlib
import time
from pathlib import Path

from sphere_nav_msgs.srv import SaveMap

from node_kit.map_bag import MapDetails, save_map
from sphere_map.graph import SphereGraph
from sphere_mapping.mapper import Mapper
from sphere_mapping.params import MapperParams, SphereMapperParams
from typed_params import to_mapping


def save(
    mapper: Mapper, params: SphereMapperParams, request: SaveMap.Request, response: SaveMap.Response
) -> SaveMap.Response:
    """Write the map built so far, its newest sphere included; say where, how large, and how long it took."""
    begin = time.monotonic()
    mapper.keep_end()
    try:
        path = path_below(Path(params.map_folder), request.path)
        path.parent.mkdir(parents=True, exist_ok=True)
        details = details_of(mapper.graph, params.mapper, frame_id=params.map_frame)
        save_map(path, mapper.graph, details, appearance=mapper.appearance, is_overwriting=request.overwrite)
    except (ValueError, OSError) as error:
        response.success, response.message = False, str(error)
        return response
    response.success, response.path, response.num_spheres = True, str(path), len(mapper.graph)
    response.message = f"{len(mapper.graph)} key spheres"
    response.num_bytes = sum(file.stat().st_size for file in path.iterdir())
    response.seconds = time.monotonic() - begin
    return response


def path_below(folder: Path, name: str) -> Path:
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
