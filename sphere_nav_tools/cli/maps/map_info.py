"""`sphere_nav map-info`: what is in a map."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sphere_nav.geometry.arrays import Array
from sphere_nav.ros.maps.reader import MapReader, open_map
from sphere_nav.spheres.experiences import find_places, split_by_experience
from sphere_nav.spheres.graph import Experience, SphereGraph
from sphere_nav_tools.offline.constants import EPOCHS_S
from sphere_nav_tools.offline.tables import columns

HELP = """\
Tell what is in a map: key spheres, edges, size, extent, and with which parameters it was made.

examples:
  sphere_nav map-info kitchen_map
  sphere_nav map-info kitchen_map --json --parameters
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("map", type=Path, metavar="MAP", help="a map (a folder)")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--parameters", action="store_true", help="the parameters of the mapping too")


def run(arguments: argparse.Namespace) -> int:
    """Read the head of the map and one sphere; print."""
    with open_map(arguments.map) as reader:
        values = map_facts(reader)
        parameters = reader.parameters if arguments.parameters else {}
    if arguments.json:
        print(json.dumps(values | ({"parameters": parameters} if arguments.parameters else {}), indent=2))
        return 0
    print("\n".join(in_words(values)))
    for name, value in parameters.items():
        print(f"  {name}: {value}")
    return 0


def in_words(facts: dict[str, Any]) -> list[str]:
    """Return the facts about a map as one reads them, a line each."""
    f = facts
    width, height = f["sphere_size"]
    places = ", ".join(f"{n} with {many}" for many, n in f["places_by_experiences"].items())
    rows = [
        ("map", f"{f['path']}, id {f['map_id']}, format {f['format_version']}, made by {f['software']}"),
        ("from", f"{f['source']}, {_when(f['first_stamp_s'])} to {_when(f['last_stamp_s'])}"),
        ("frame", f"{f['frame']}" + (f", its origin at {f['origin']}" if f["origin"] else "")),
        ("way", f"{f['length_m']:.2f} m, within {' x '.join(f'{side:.2f}' for side in f['extent_m'])} m (x, y, z)"),
        ("key spheres", f"{f['key_spheres']}, {f['edges']} edges, {f['loops']} of them loops"),
        ("apart", _span(f["spacing_m"])),
        ("valid within", _span(f["region_radius_m"])),
        (
            "images",
            f"{width} x {height} pixels, {f['pixels_per_degree']:g} a degree, {f['measured_share']:.0%} with range",
        ),
        ("view", "all around" if f["whole_sphere"] else "a part of the sphere"),
        ("size", f"{f['megabytes']:g} MB, {f['megabytes_per_sphere']:g} a key sphere"),
        ("rig", "calibration in the map" if f["rig"] else "none"),
        ("experiences", f"{len(f['experiences'])}; places by how many they have: {places}"),
    ]
    for experience in f["experiences"]:
        served, last = experience["images_served"], experience["last_served_s"]
        used = f"placed {served:g} images, last {_when(last)}" if last else "placed no image yet"
        drive = f"drive {experience['drive'] or 'without a name'}, {_when(experience['first_stamp_s'])}"
        rows.append(
            (f"  {experience['name'] or 'first'}", f"{experience['key_spheres']} key spheres of {drive}; {used}")
        )
    return columns(rows)


def _when(seconds: float) -> str:
    """Return a stamp as date and time (UTC); those of a simulator, which begin at 0, in seconds."""
    if seconds < EPOCHS_S:
        return f"{seconds:.1f} s"
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")


def _span(found: list[float]) -> str:
    """Return the smallest, the median and the largest of lengths."""
    return f"{found[0]:.2f} to {found[2]:.2f} m, median {found[1]:.2f} m" if found else "not known"


def map_facts(reader: MapReader) -> dict[str, Any]:
    """Return the facts about a map by name."""
    graph, info = reader.graph, reader.info
    nodes = sorted(graph, key=lambda node: node.id)
    positions = np.array([node.T_map_sphere.translation for node in nodes])
    sphere = reader.load_sphere(nodes[0].id)
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
        "length_m": round(float(info.length), 3),
        "extent_m": [round(float(side), 3) for side in np.ptp(positions, axis=0)],
        "spacing_m": spacing(positions),
        "region_radius_m": quantiles([node.region_radius_m for node in nodes if node.region_radius_m > 0]),
        "first_stamp_s": nodes[0].stamp_ns / 1e9,
        "last_stamp_s": nodes[-1].stamp_ns / 1e9,
        "sphere_size": [sphere.camera.width, sphere.camera.height],
        "whole_sphere": bool(sphere.camera.is_whole),
        "pixels_per_degree": round(float(np.radians(sphere.camera.pixels_per_radian)), 2),
        "measured_share": round(float(sphere.measured.mean()), 3),
        "megabytes": round(size / 1e6, 1),
        "megabytes_per_sphere": round(size / 1e6 / len(graph), 2),
        "megabytes_per_metre": round(size / 1e6 / info.length, 3) if info.length > 0 else None,
        "rig": bool(info.rig),
        "places_by_experiences": count_places(graph, is_whole=sphere.camera.is_whole),
        "experiences": [describe_experience(*item) for item in split_by_experience(graph).items()],
    }


def count_places(graph: SphereGraph, *, is_whole: bool) -> dict[str, int]:
    """Return how many key spheres have so many experiences at their place."""
    counts = Counter(len(found) for found in find_places(graph, is_whole=is_whole).values())
    return {str(number): counts[number] for number in sorted(counts)}


def describe_experience(experience: Experience, part: SphereGraph) -> dict[str, Any]:
    """Return what is told of an experience: when it was, what it served, and when last."""
    last_ns = max(node.last_served_ns for node in part)
    return {
        "name": experience.name,
        "drive": experience.drive,
        "camera": experience.camera,
        "first_stamp_s": experience.stamp_ns / 1e9,
        "key_spheres": len(part),
        "images_served": round(sum(node.served for node in part), 1),
        "last_served_s": last_ns / 1e9 if last_ns else None,
    }


def spacing(positions: Array) -> list[float]:
    """Return the smallest, the median and the largest distance in m from a key sphere to the next one."""
    return quantiles(np.linalg.norm(np.diff(positions, axis=0), axis=1))


def quantiles(values: ArrayLike) -> list[float]:
    """Return the smallest, the median and the largest of some values, rounded; nothing of none."""
    numbers = np.asarray(values, dtype=np.float64)
    return [round(float(value), 3) for value in np.quantile(numbers, [0.0, 0.5, 1.0])] if numbers.size else []
