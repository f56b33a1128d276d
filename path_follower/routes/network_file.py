"""A network as GeoJSON that Nav2's Route Server reads, in metres of the map, with the dense curve of every edge.

Nodes are Points, edges MultiLineStrings with `startid` and `endid`, as nav2_route's GeoJsonGraphFileLoader wants them;
numbers of nodes and edges differ. Route Server ignores `curve`, the columns of the dense points, and `network`, what
belongs to the whole. An edge that may be driven backwards has a twin for it, `twin_of`, which is left out on reading.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from path_follower.path import Pose2, between
from path_follower.path_files import COLUMNS
from path_follower.routes.constants import MAX_CURVE_GAP, MAX_ITEMS, MAX_NAME
from path_follower.routes.network import Network, RouteEdge
from path_follower.smoothing import Curve
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.files.untrusted import LIMITS, load_json, numbers, read_as, read_text, required, short
from sphere_nav.geometry.files.whole_file import write_whole

FORMAT, VERSION = "sphere_nav routes", 1
FILE_NAME = "routes.geojson"  # in the folder of its map
_FRAME = "map"  # that Route Server is told
DECIMALS = 4  # of metres and radians


def network_path(path: Path) -> Path:
    """Return the file of a network: the one that is named, or that of the map whose folder is."""
    return path / FILE_NAME if path.is_dir() else path


def write_network(path: str | os.PathLike[str], network: Network) -> None:
    """Write a network; the file appears whole or not at all."""
    write_whole(Path(path), to_geojson(network))


def read_network(path: str | os.PathLike[str]) -> Network:
    """Read a network; ValueError in one line for anything that is none."""
    return from_geojson(read_text(path, "network of routes (GeoJSON)", LIMITS["routes"]), str(path))


def to_geojson(network: Network, *, is_dense: bool = True) -> str:
    """Return the text of the file; without the dense curves a quarter as long, to be shown."""
    twin_ids = count(max([*network.nodes, *network.edges], default=0) + 1)
    features = [_node_feature(network, *node) for node in network.nodes.items()]
    features += [_edge_feature(edge, is_dense=is_dense) for edge in network.edges.values()]
    both = (edge for edge in network.edges.values() if edge.is_reverse and edge.is_forward)
    features += [_edge_feature(edge, next(twin_ids)) for edge in both]
    head = {"format": FORMAT, "version": VERSION, "map_id": network.map_id, "frame": _FRAME}
    whole = {"type": "FeatureCollection", "name": "graph", "network": head, "features": features}
    return json.dumps(whole, allow_nan=False)


def _node_feature(network: Network, node: int, pose: Pose2) -> dict[str, Any]:
    properties: dict[str, Any] = {"id": node, "frame": _FRAME, "yaw": round(pose.yaw, 6)}
    if names := [name for name, number in network.places.items() if number == node]:
        properties |= {"names": names, "metadata": {"name": names[0]}}
    geometry = {"type": "Point", "coordinates": [round(pose.x, DECIMALS), round(pose.y, DECIMALS)]}
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _edge_feature(edge: RouteEdge, twin_id: int | None = None, *, is_dense: bool = False) -> dict[str, Any]:
    """Return an edge as it is driven, or its twin with a number of its own: as it is driven backwards."""
    is_driven_forward = edge.is_forward and twin_id is None
    known = edge.curve.speed[np.isfinite(edge.curve.speed)]
    metadata: dict[str, Any] = {"length": round(edge.length, 3)}
    metadata |= {"forward": edge.is_forward, "reverse": edge.is_reverse}
    metadata |= {"abs_speed_limit": round(float(known.max()), 3)} if len(known) else {}
    start, end = edge.ends(1 if is_driven_forward else -1)
    properties: dict[str, Any] = {"id": edge.id if twin_id is None else twin_id, "startid": start, "endid": end}
    properties |= {"cost": round(edge.seconds(2.0), 3), "overridable": True, "metadata": metadata}
    curve = {name: _column(values) for name, values in zip(COLUMNS, edge.curve.columns, strict=True)}
    properties |= {"curve": curve} if is_dense else {}
    properties |= {} if twin_id is None else {"twin_of": edge.id}
    points = list(zip(curve["x"], curve["y"], strict=True))
    shown = [*points[:-1:5], points[-1]]
    geometry = {"type": "MultiLineString", "coordinates": [shown if twin_id is None else shown[::-1]]}
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _column(values: Array) -> list[float | None]:
    return [round(value, DECIMALS) if math.isfinite(value) else None for value in values.tolist()]


# --- reading
@dataclass(frozen=True)
class _Head:
    format: str
    version: int
    map_id: str


@dataclass(frozen=True)
class _Node:
    yaw: float
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Curve:
    x: tuple[float, ...]
    y: tuple[float, ...]
    yaw: tuple[float, ...]
    speed: tuple[float | None, ...]


@dataclass(frozen=True)
class _Metadata:
    forward: bool
    reverse: bool


@dataclass(frozen=True)
class _EdgeFields:
    startid: int
    endid: int
    metadata: _Metadata
    curve: _Curve


def from_geojson(text: str, where: str = "network") -> Network:
    """Return the network of a text; ValueError in one line for anything else."""
    whole = required(load_json(where, text), where, ("network", "features"))
    head: _Head = read_as(_Head, whole["network"], f"{where}: network")
    if (head.format, head.version) != (FORMAT, VERSION):
        found = f"{short(head.format)} {head.version}"
        raise ValueError(f"{where}: network: expected format {FORMAT!r} version {VERSION}, found {found}")
    features = whole["features"]
    if not isinstance(features, list) or len(features) > 2 * MAX_ITEMS:
        raise ValueError(f"{where}: features: expected a list of at most {2 * MAX_ITEMS}, found {short(features)}")
    nodes: dict[int, Pose2] = {}
    edges: dict[int, RouteEdge] = {}
    places: dict[str, int] = {}
    for index, feature in enumerate(features):
        at = f"{where}: features[{index}]"
        fields = required(required(feature, at, ("geometry", "properties"))["properties"], f"{at}.properties", ("id",))
        key, geometry = read_as(int, fields["id"], f"{at}.properties.id"), feature["geometry"]
        if "twin_of" in fields:
            continue
        if key in nodes or key in edges or not 0 <= key < 2**31:
            raise ValueError(f"{at}.properties.id: expected a number that is not taken, found {short(key)} again")
        if required(geometry, f"{at}.geometry", ("type", "coordinates"))["type"] == "Point":
            node: _Node = read_as(_Node, fields, f"{at}.properties")
            x, y = numbers(geometry["coordinates"], f"{at}.geometry.coordinates", 2)
            nodes[key] = Pose2(x, y, node.yaw)
            places |= dict.fromkeys(node.names, key)
        else:
            edges[key] = _read_edge(fields, key, f"{at}.properties")
    if not nodes or not edges:
        raise ValueError(f"{where}: expected nodes and edges, found {len(nodes)} and {len(edges)}")
    for name in (head.map_id, *places):
        if len(name) > MAX_NAME or not name.isprintable():
            raise ValueError(f"{where}: expected a short text, found {short(name)}")
    network = Network(nodes, edges, places, head.map_id)
    _check_ends(network, where)
    return network


def _read_edge(fields: Mapping[str, Any], key: int, at: str) -> RouteEdge:
    edge: _EdgeFields = read_as(_EdgeFields, fields, at)
    x, y, yaw, speed = (np.array(getattr(edge.curve, name), dtype=np.float64) for name in COLUMNS)  # None becomes NaN
    if not len(x) == len(y) == len(yaw) == len(speed) or len(x) < 2:
        found = f"{len(x)}, {len(y)}, {len(yaw)}, {len(speed)}"
        raise ValueError(f"{at}.curve: expected columns of one length, 2 or more, found {found}")
    if (gap := float(np.hypot(np.diff(x), np.diff(y)).max())) > MAX_CURVE_GAP:
        raise ValueError(f"{at}.curve: expected points at most {MAX_CURVE_GAP} m apart, found {gap:.3g} m")
    told = edge.metadata
    start, end = (edge.startid, edge.endid) if told.forward else (edge.endid, edge.startid)
    return RouteEdge(key, start, end, Curve(x, y, yaw, speed), told.forward, told.reverse)


def _check_ends(network: Network, where: str) -> None:
    for edge in network.edges.values():
        for end, index in ((edge.start, 0), (edge.end, -1)):
            if end not in network.nodes:
                raise ValueError(f"{where}: edge {edge.id}: expected nodes that exist, found {end}")
            gap = math.hypot(*between(network.nodes[end], edge.curve.point(index))[:2])
            if gap > MAX_CURVE_GAP:
                found = f"{gap:.3g} m off"
                raise ValueError(f"{where}: edge {edge.id}: expected its curve to end at node {end}, found {found}")
