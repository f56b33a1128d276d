"""The service `save_map`: the map built so far as a folder below the node's map folder."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from sphere_nav_msgs.srv import SaveMap

from node_kit.map_bag import save_map
from sphere_map.graph import SphereGraph
from sphere_mapping.details_node import details_of
from sphere_mapping.graph.merging import merge
from sphere_mapping.journal_node import Journal
from sphere_mapping.mapper import Mapper
from sphere_mapping.params import SphereMapperParams


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
    try:
        path = path_below(Path(params.map_folder), request.path)
        path.parent.mkdir(parents=True, exist_ok=True)
        graph = graph_to_save(mapper)
        details = details_of(graph, params.mapper, frame_id=params.map_frame)
        load, seen, is_overwriting = mapper.load_sphere, mapper.appearance, request.overwrite
        save_map(path, graph, details, load_sphere=load, appearance=seen, is_overwriting=is_overwriting)
    except (ValueError, OSError) as error:
        response.success, response.message = False, str(error)
        return response
    if journal is not None:
        journal.saved()
    response.success, response.path, response.num_spheres = True, str(path), len(graph)
    response.message = f"{len(graph)} key spheres"
    response.num_bytes = sum(file.stat().st_size for file in path.iterdir())
    response.seconds = time.monotonic() - begin
    return response


def graph_to_save(mapper: Mapper) -> SphereGraph:
    """Return the graph without the key spheres of places that others show as well; the mapper keeps them all."""
    if not mapper.params.key.merge:
        return mapper.graph
    return merge(mapper.graph, np.array([pose.translation for _, pose in mapper.trajectory()])).graph


def path_below(folder: Path, name: str) -> Path:
    """Return the path of a map; ValueError unless it lies below the folder."""
    root = folder.resolve()
    path = (root / name).resolve()
    if not name or path == root or not path.is_relative_to(root):
        raise ValueError(f"path: expected a folder below {root} (parameter map_folder), found {name!r}")
    return path
