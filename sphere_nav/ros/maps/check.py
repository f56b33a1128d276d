"""Check a map sphere by sphere; rescue what is readable of a damaged one."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from sphere_nav_msgs.msg import MapExperience, MapInfo

from sphere_nav.geometry.files.untrusted import load_yaml
from sphere_nav.ros.bags.mcap_file import whole_messages
from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.conversions import message_to_sphere, sphere_to_message
from sphere_nav.ros.conversions.graphs import message_to_experience, message_to_graph
from sphere_nav.ros.interfaces import from_bytes, type_name
from sphere_nav.ros.maps.reader import open_map
from sphere_nav.ros.maps.writer import (
    EXPERIENCE,
    FILE_NAME,
    GRAPH,
    INFO,
    KINDS,
    SPHERE,
    SPHERE_FRAME,
    MapDetails,
    Progress,
    write_stored,
)
from sphere_nav.spheres.coarse import coarse_sphere
from sphere_nav.spheres.experiences import with_experience
from sphere_nav.spheres.graph import SphereGraph


def verify_map(path: Path, progress: Progress = lambda step: None) -> list[str]:
    """Read all that is in a map; return the problems, one a line. BagError if it cannot be opened."""
    problems = []
    with open_map(path) as reader:
        for read in (reader.coarse_spheres, reader.appearance):
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


def salvage_map(source: Path, target: Path, progress: Progress = lambda step: None) -> int:
    """Make a map of the last graph that a damaged one has and of the spheres that are whole; return their number."""
    file = source / FILE_NAME if source.is_dir() else source
    last: dict[str, Any] = {}
    experiences: list[MapExperience] = []
    whole = set[int]()
    for topic, message in _readable(file):
        progress(1)
        if topic == SPHERE:
            whole.add(int(message.id))
        elif topic == EXPERIENCE:
            experiences.append(message)
        elif topic in (INFO, GRAPH) and message.format_version == MapInfo.FORMAT_VERSION:
            last[topic] = message
    if not whole:
        raise BagError(f"{file}: expected readable parts of a map of format {MapInfo.FORMAT_VERSION}, found none")
    if GRAPH not in last:
        raise BagError(f"{file}: {len(whole)} key spheres are readable, but not the graph that says where they are")
    told, info = last[GRAPH], last.get(INFO) or MapInfo()
    known = message_to_graph(told)
    kept = whole & known.nodes.keys()
    edges = [edge for edge in known.edges if {edge.a, edge.b} <= kept]
    graph = SphereGraph([node for node in known if node.id in kept], edges)
    for one in experiences:
        graph = with_experience(graph, message_to_experience(one), kept & {int(number) for number in one.ids})
    parameters = load_yaml(file, info.parameters)
    details = MapDetails(told.map_id, told.software, info.source, parameters, info.rig, told.header.frame_id)
    wholes = (message for topic, message in _readable(file) if topic == SPHERE)
    smalls = ((whole, coarse_sphere(message_to_sphere(whole))) for whole in wholes)
    stored = ((whole, sphere_to_message(small, SPHERE_FRAME, int(whole.id))) for whole, small in smalls)
    write_stored(target, graph, details, None, stored)
    return len(kept)


def _readable(file: Path) -> Iterator[tuple[str, Any]]:
    """Yield topic and message of all that is whole in a map; what is no message of its type is passed over."""
    for schema, channel, record in whole_messages(file):
        kind = KINDS.get(channel.topic)
        if kind is not None and schema.name == type_name(kind):
            with suppress(ValueError):
                yield channel.topic, from_bytes(record.data, kind)
