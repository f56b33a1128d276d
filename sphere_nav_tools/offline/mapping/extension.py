"""`sphere_nav map --extend MAP0`: a drive joined to a map in whatever light; that map stays as it is."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sphere_mapping.experiences.joining import join_drive
from sphere_mapping.graph.extension import Submap
from sphere_mapping.graph.verification import Run
from sphere_nav.geometry import SE3
from sphere_nav.geometry.files.untrusted import load_yaml
from sphere_nav.ros.bags import BagError
from sphere_nav.ros.maps.reader import FILE_NAME, MapReader, open_map
from sphere_nav.ros.shared_files import software
from sphere_nav.spheres.appearance.features import features_of_sphere
from sphere_nav.spheres.appearance.index import AppearanceIndex
from sphere_nav.spheres.experiences import Service, with_service
from sphere_nav_tools.offline.mapping.drive_locator import LocatedMapper


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


def extend(
    mapper: LocatedMapper, T_map_start: SE3 | None = None, run: Run = map
) -> tuple[AppearanceIndex, str, set[int]]:
    """Move what was mapped into the frame of the map, both in one graph; BagError where nothing says where it was.

    Return what all key spheres of the joint map look like, what is told of the joining, and the new ones by id.
    """
    base = mapper.base
    known = Submap(base.graph, base.appearance(), base.load_sphere)
    drive = Submap(mapper.graph, mapper.appearance, mapper.load_sphere)
    for node in drive.graph:
        if node.id not in drive.index.features:  # nobody has looked at it yet
            drive.index.add(node.id, features_of_sphere(drive.load(node.id)))
    new = mapper.unexplained()
    joined = join_drive(known, drive, mapper.images(), T_map_start, run)
    if joined.graph is None:
        raise BagError(f"{base.path}: expected a drive by places of the map, found none that hold: {joined.told}")
    lacking: defaultdict[int, float] = defaultdict(float)  # what the map does not show of the images of a key sphere
    for track in mapper.tracks:
        lacking[track.key_id] += mapper.lacking(track.stamp_ns)
    own = {node.id: Service(lacking[node.id], node.stamp_ns) for node in drive.graph}
    mapper.graph = with_service(joined.graph, mapper.served, own, len(mapper.tracks) / max(len(drive.graph), 1))
    for sphere_id, features in drive.index.features.items():
        known.index.add(sphere_id, features)
    told = f"joined to {base.path}: {joined.told}; {len(new)} of {len(drive.graph)} key spheres show what it did not"
    return known.index, told, new


def place_start(base: MapReader, start: Sequence[float], T_base_sphere: SE3) -> SE3:
    """Return where the first sphere was, by x, y (m) and heading (rad) of base_link; else as the nearest key sphere."""
    x, y, yaw = start
    near = min(base.graph, key=lambda node: float(np.linalg.norm(node.T_map_sphere.translation[:2] - (x, y))))
    T_map_base = near.T_map_sphere @ T_base_sphere.inverse()
    turned = SE3.from_planar(0.0, 0.0, yaw - float(T_map_base.angles[2])).rotation @ T_map_base.rotation
    return SE3.from_parts(turned, np.array([x, y, T_map_base.translation[2]])) @ T_base_sphere
