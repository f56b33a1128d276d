"""`sphere_nav map-info`: what is in a map."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from sphere_nav.ros.maps.reader import MapReader, open_map
from sphere_nav.spheres.experiences import find_places, split_by_experience
from sphere_nav.spheres.graph import Experience, SphereGraph
from sphere_nav_tools.offline.settings import add, flag
from sphere_nav_tools.offline.tables import facts_as_lines

HELP = """\
Tell what is in a map: key spheres, edges, size, extent, and with which parameters it was made.

examples:
  sphere_nav map-info kitchen_map
  sphere_nav map-info kitchen_map --json --parameters
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add(parser, "map", "MAP", "a map (a folder)", Path)
    flag(parser, "--json", "print JSON")
    flag(parser, "--parameters", "the parameters of the mapping too")


def run(arguments: argparse.Namespace) -> None:
    """Read the head of the map and one sphere; print."""
    with open_map(arguments.map) as reader:
        facts, parameters = map_facts(reader), reader.parameters if arguments.parameters else {}
    if arguments.json:
        print(json.dumps(facts | ({"parameters": parameters} if parameters else {}), indent=2))
    else:
        print("\n".join(facts_as_lines(facts | parameters)))


def map_facts(reader: MapReader) -> dict[str, Any]:
    """Return the facts about a map by name."""
    graph, info = reader.graph, reader.info
    nodes = list(graph)
    positions = np.array([node.T_map_sphere.translation for node in nodes])
    sphere = reader.load_sphere(nodes[0].id)
    shared = Counter(map(len, find_places(graph, is_whole=sphere.camera.is_whole).values()))
    size = sum(file.stat().st_size for file in reader.path.iterdir()) if reader.path.is_dir() else 0
    return {
        "path": str(reader.path),
        "map_id": info.map_id,
        "format_version": int(info.format_version),
        "software": info.software,
        "source": info.source,
        "frame": info.header.frame_id,
        "origin": reader.origin,
        "key_spheres": len(graph),
        "edges": len(graph.edges),
        "loops": sum(edge.is_loop for edge in graph.edges),
        "length_m": float(info.length),
        "extent_m": np.ptp(positions, axis=0).tolist(),
        "region_radius_m": float(np.median([node.region_radius_m for node in nodes])),
        "first_stamp_s": nodes[0].stamp_ns / 1e9,
        "last_stamp_s": nodes[-1].stamp_ns / 1e9,
        "sphere_size": [sphere.camera.width, sphere.camera.height],
        "whole_sphere": bool(sphere.camera.is_whole),
        "measured_share": float(sphere.measured.mean()),
        "megabytes": size / 1e6,
        "rig": bool(info.rig),
        "places_by_experiences": {str(number): count for number, count in sorted(shared.items())},
        "experiences": [describe_experience(*item) for item in split_by_experience(graph).items()],
    }


def describe_experience(experience: Experience, part: SphereGraph) -> dict[str, Any]:
    """Return what is told of an experience: when it was, what it served, and when last."""
    last_ns = max(node.last_served_ns for node in part)
    return {
        "name": experience.name,
        "drive": experience.drive,
        "camera": experience.camera,
        "first_stamp_s": experience.stamp_ns / 1e9,
        "key_spheres": len(part),
        "images_served": float(sum(node.served for node in part)),
        "last_served_s": last_ns / 1e9 if last_ns else None,
    }
