"""Check a map sphere by sphere; rescue what is readable of a damaged one."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from sphere_nav_msgs.msg import KeySphereGraph, MapExperience, MapInfo

from sphere_nav.geometry.files.untrusted import load_yaml
from sphere_nav.ros.bags.mcap_salvage import Salvage
from sphere_nav.ros.bags.reader import deserialize
from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.conversions import message_to_sphere
from sphere_nav.ros.conversions.graphs import message_to_experience, message_to_graph
from sphere_nav.ros.interfaces import type_name
from sphere_nav.ros.maps.reader import (
    EXPERIENCE,
    FILE_NAME,
    GRAPH,
    GROWTH,
    INFO,
    KINDS,
    SPHERE,
    MapDetails,
    Progress,
    open_map,
    save_map,
)
from sphere_nav.spheres.experiences import with_experience
from sphere_nav.spheres.graph import SphereGraph
from sphere_nav.spheres.sphere import Sphere


def verify_map(path: str | Path, progress: Progress = lambda step: None) -> list[str]:
    """Read all that is in a map; return the problems, one a line. BagError if it cannot be opened."""
    problems = []
    with open_map(path) as reader:
        for read in (reader.coarse_spheres, reader.appearance, reader.read_growth):
            try:
                read()
            except BagError as error:
                problems.append(str(error))
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
    spheres, graphs, infos, experiences = _readable(file, progress)
    if not spheres:
        raise BagError(f"{file}: expected readable parts of a map of format {MapInfo.FORMAT_VERSION}, found none")
    if not graphs:
        raise BagError(f"{file}: {len(spheres)} key spheres are readable, but not the graph that says where they are")
    message, whole = graphs[-1]  # grown since the last whole one
    nodes = [replace(node, sphere=spheres[node.id]) for node in whole if node.id in spheres]
    kept = {node.id for node in nodes}
    edges = [edge for edge in whole.edges if edge.a in kept and edge.b in kept]
    details = MapDetails(message.map_id, message.software, frame_id=message.header.frame_id)
    if infos:
        info = infos[-1]
        details = replace(details, source=info.source, parameters=_parameters(info), rig=info.rig)
    graph = SphereGraph(nodes, edges)
    for one in experiences:
        graph = with_experience(graph, message_to_experience(one), kept & {int(number) for number in one.ids})
    save_map(target, graph, details)
    return len(nodes)


Found = tuple[dict[int, Sphere], list[tuple[KeySphereGraph, SphereGraph]], list[MapInfo], list[MapExperience]]


def _readable(file: Path, progress: Progress) -> Found:
    """Return the spheres by id, the graphs as messages and as they are, infos and experiences that are whole."""
    spheres: dict[int, Sphere] = {}
    graphs: list[tuple[KeySphereGraph, SphereGraph]] = []
    infos: list[MapInfo] = []
    experiences: list[MapExperience] = []
    for channel, schema, record in Salvage(file).messages():
        if channel.topic not in KINDS or schema.name != type_name(KINDS[channel.topic]):
            continue
        with suppress(BagError, ValueError):  # what is damaged is left out
            message = deserialize(record.data, KINDS[channel.topic], str(file))
            if channel.topic == SPHERE:
                spheres[int(message.id)] = message_to_sphere(message)
            elif channel.topic == GROWTH and message.format_version == MapInfo.FORMAT_VERSION:
                graphs.append((message, grown(graphs[-1][1] if graphs else SphereGraph(), message_to_graph(message))))
            elif channel.topic == GRAPH and message.format_version == MapInfo.FORMAT_VERSION:
                graphs.append((message, message_to_graph(message)))
            elif channel.topic == INFO and message.format_version == MapInfo.FORMAT_VERSION:
                infos.append(message)
            elif channel.topic == EXPERIENCE:
                experiences.append(message)
        progress(1)
    return spheres, graphs, infos, experiences


def grown(graph: SphereGraph, growth: SphereGraph) -> SphereGraph:
    """Return a graph with the key sphere that came last and its edges; the others of `growth` are their older ends."""
    new = [node for node in [max(growth, key=lambda node: node.id)] if node.id not in graph.nodes]
    known = graph.nodes.keys() | {node.id for node in new}
    edges = [edge for edge in growth.edges if edge.a in known and edge.b in known] if new else []
    return SphereGraph([*graph, *new], [*graph.edges, *edges])


def _parameters(info: MapInfo) -> dict[str, Any]:
    try:
        found = load_yaml("parameters", info.parameters)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}
