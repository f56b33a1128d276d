"""Check a map sphere by sphere; rescue what is readable of a damaged one."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml
from rclpy.serialization import deserialize_message
from sphere_nav_msgs.msg import KeySphereGraph, MapInfo

from node_kit.bag_error import BagError
from node_kit.conversions import message_to_sphere
from node_kit.conversions.graphs import message_to_graph
from node_kit.map_bag import FILE_NAME, GRAPH, INFO, KINDS, SPHERE, MapDetails, Progress, open_map, save_map
from node_kit.mcap_file import salvaged_messages
from sphere_map.graph import SphereGraph
from sphere_map.sphere import Sphere


def verify_map(path: str | Path, progress: Progress = lambda step: None) -> list[str]:
    """Read every key sphere of a map; return the problems, one a line. BagError if it cannot be opened."""
    problems = []
    with open_map(path) as reader:
        for node in reader.graph:
            try:
                sphere = reader.load_sphere(node.id)
                if sphere.stamp_ns != node.stamp_ns:
                    problems.append(
                        f"{path}: key sphere {node.id}: expected stamp {node.stamp_ns}, found {sphere.stamp_ns}"
                    )
            except BagError as error:
                problems.append(str(error))
            progress(1)
    return problems


def salvage_map(source: str | Path, target: str | Path, progress: Progress = lambda step: None) -> int:
    """Make a map of the spheres that a truncated one still has, with the last graph that it has; return their number.

    A map that was cut before its graph keeps its spheres, but not where they are: that is refused.
    """
    source = Path(source)
    file = source / FILE_NAME if source.is_dir() else source
    spheres, graphs, infos = _readable(file, progress)
    if not infos or infos[0].format_version != MapInfo.FORMAT_VERSION:
        raise BagError(f"{file}: expected a readable MapInfo of format {MapInfo.FORMAT_VERSION}, found none")
    if not graphs:
        raise BagError(f"{file}: {len(spheres)} key spheres are readable, but not the graph that says where they are")
    whole = message_to_graph(graphs[-1])
    nodes = [replace(node, sphere=spheres[node.id]) for node in whole if node.id in spheres]
    kept = {node.id for node in nodes}
    edges = [edge for edge in whole.edges if edge.a in kept and edge.b in kept]
    info = infos[0]
    details = MapDetails(
        info.map_id, info.software, info.source, yaml.safe_load(info.parameters) or {}, info.rig, info.header.frame_id
    )
    save_map(target, SphereGraph(nodes, edges), details)
    return len(nodes)


def _readable(file: Path, progress: Progress) -> tuple[dict[int, Sphere], list[KeySphereGraph], list[MapInfo]]:
    channels: dict[int, Any] = {}
    found: dict[str, list[Any]] = {topic: [] for topic in KINDS}
    with suppress(BagError):  # what is damaged is left out
        for message, _ in salvaged_messages(file, channels):
            topic = channels[message.channel_id].topic
            if topic in KINDS:
                found[topic].append(deserialize_message(message.data, KINDS[topic]))
                progress(1)
    spheres: dict[int, Sphere] = {}
    for item in found[SPHERE]:
        with suppress(ValueError):
            spheres[int(item.id)] = message_to_sphere(item)
    return spheres, found[GRAPH], found[INFO]
