"""What a map of this mapper says about itself."""

from __future__ import annotations

import hashlib

from node_kit.map_bag import MapDetails
from sphere_map.graph import SphereGraph
from sphere_mapping.params import MapperParams
from typed_params import to_mapping


def details_of(graph: SphereGraph, params: MapperParams, source: str = "", frame_id: str = "map") -> MapDetails:
    """Return what a map says about itself; its id is a checksum of stamps and poses."""
    digest = hashlib.sha256()
    for node in graph:
        digest.update(node.stamp_ns.to_bytes(8, "little", signed=True) + node.T_map_sphere.matrix.tobytes())
    return MapDetails(digest.hexdigest()[:16], source=source, parameters=to_mapping(params), frame_id=frame_id)
