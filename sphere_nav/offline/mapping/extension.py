"""`sphere_nav map --extend MAP0`: a drive joined to a map by the places that both saw; that map stays as it is."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from sphere_mapping.graph.extension import Submap, find_joins, join_graphs
from sphere_mapping.graph.verification import Run
from sphere_mapping.mapper import Mapper
from sphere_nav.geometry.files.untrusted import load_yaml
from sphere_nav.ros.bags import BagError
from sphere_nav.ros.maps.reader import FILE_NAME, MapReader, open_map
from sphere_nav.ros.shared_files import software
from sphere_nav.spheres.appearance.features import features_of_sphere
from sphere_nav.spheres.appearance.index import AppearanceIndex


@dataclass(frozen=True, eq=False)
class Extension:
    """What all key spheres of the joint map look like, and what is told of the joining."""

    index: AppearanceIndex
    told: str


def open_base(path: Path, output: Path, rig: str) -> MapReader:
    """Open the map to extend; BagError where the new one would replace it, or was not made as it was."""
    folder = path.parent if path.name == FILE_NAME else path
    if folder.resolve() == output.resolve():
        raise BagError(f"{output}: expected another folder than that of --extend, which stays as it is, found the same")
    base = open_map(path)
    try:
        if base.info.software != software():
            raise BagError(f"{path}: software: expected {software()}, found {base.info.software}")
        if load_yaml(f"{path}: rig", base.info.rig) != load_yaml("--rig", rig):
            expected = "that of the map" if base.info.rig else "none, as the map has none"
            raise BagError(f"{path}: --rig: expected {expected}, found {'another one' if rig else 'none'}")
    except ValueError:
        base.close()
        raise
    return base


def extend(base: MapReader, mapper: Mapper, run: Run = map) -> Extension:
    """Move what was mapped into the frame of the map, both in one graph; BagError where they share no places."""
    known = Submap(base.graph, base.appearance(), base.load_sphere)
    drive = Submap(mapper.graph, mapper.appearance, mapper.load_sphere)
    for part in (known, drive):
        learn_appearance(part)
    joins = find_joins(known, drive, mapper.params, run)
    if not joins.edges:
        raise BagError(f"{base.path}: expected a drive by places of the map, found none that hold: {joins}")
    mapper.graph = join_graphs(known.graph, drive.graph, joins.edges)
    for sphere_id, features in drive.index.features.items():
        known.index.add(sphere_id, features)
    return Extension(known.index, f"joined to {base.path}: {joins}")


def learn_appearance(part: Submap) -> None:
    """Take note of what key spheres look like where nobody has."""
    for node in part.graph:
        if node.id not in part.index.features:
            part.index.add(node.id, features_of_sphere(part.load(node.id)))
