"""`sphere_nav map --extend MAP0`: a drive joined to a map in whatever light; that map stays as it is.

The spheres of the drive are localised in the map as they are mapped.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from dense_localizer.judge.estimate import CameraEstimate
from dense_localizer.key_images import is_alike
from dense_localizer.localizer import Localizer
from dense_localizer.params import LocalizerParams
from sphere_mapping.experiences.joining import DriveSphere, Localized, join_drive
from sphere_mapping.graph.extension import Submap
from sphere_mapping.graph.keyframes import MapUpdate
from sphere_mapping.graph.tracking import Unroll
from sphere_mapping.graph.verification import Run
from sphere_mapping.mapper import Mapper
from sphere_nav.geometry import SE3
from sphere_nav.geometry.files.untrusted import load_yaml
from sphere_nav.localization.params import InputParams, StateParams
from sphere_nav.localization.status import State
from sphere_nav.ros.bags import BagError
from sphere_nav.ros.bags.recorded import serialize_to_store
from sphere_nav.ros.conversions import sphere_to_message
from sphere_nav.ros.maps.compact import CompactSpheres
from sphere_nav.ros.maps.reader import FILE_NAME, MapReader, open_map
from sphere_nav.ros.maps.writer import SPHERE_FRAME
from sphere_nav.ros.shared_files import software
from sphere_nav.spheres.appearance.features import features_of_sphere
from sphere_nav.spheres.appearance.index import AppearanceIndex
from sphere_nav.spheres.coarse import coarse_sphere
from sphere_nav.spheres.experiences import Service, count_image, with_service
from sphere_nav.spheres.sphere import Sphere
from sphere_nav_tools.offline.constants import MIN_EXPLAINED_SHARE, PATIENCE_S


@dataclass
class Seen:
    """What a map was to a sphere of a drive: where it was in it, and the share 0...1 that the map does not show."""

    found: Localized | None
    number: int  # of its small copy
    lack: float = 1.0
    is_explained: bool = False


def drive_localizer(base: MapReader) -> Localizer:
    """Return what localises the spheres of a drive in a map."""
    params = LocalizerParams(
        input=InputParams(timeout_s=PATIENCE_S, allow_still=True), state=StateParams(max_blind_s=PATIENCE_S)
    )
    return Localizer(params, base)


class LocatedMapper(Mapper):
    """Localises every sphere that it maps in a map, by its own motion as odometry.

    Its key spheres are numbered behind those of the map.
    """

    def __init__(self, base: MapReader, localizer: Localizer, *words: Any, **named: Any) -> None:
        super().__init__(*words, **named)
        self.first_id = max(base.graph.nodes) + 1
        self.base, self._localizer = base, localizer
        self._seen: dict[int, Seen] = {}  # by the stamp
        self._probation: dict[int, CameraEstimate] = {}  # the latest ones, by the stamp, while they are in probation
        self._small = CompactSpheres()
        self._T_odom_sphere = SE3.identity()
        self.served: dict[int, Service] = {}

    def add(self, sphere: Sphere, odometry: SE3 | None = None, unroll: Unroll | None = None) -> MapUpdate:
        """Map one sphere, and localise it, straightened by its motion."""
        update = super().add(sphere, odometry, unroll)
        if sphere.stamp_ns not in self._seen:
            last = self._tracker.last if update.T_map_sphere is not None else None
            self._observe(last.sphere if last is not None else sphere, update)
        return update

    def _observe(self, sphere: Sphere, update: MapUpdate) -> None:
        stamp_ns = sphere.stamp_ns
        estimate = self._localizer.update(sphere.gray, sphere.camera, stamp_ns, self._odometry(update))
        self._seen[stamp_ns] = seen = Seen(self._locate(estimate), len(self._seen))
        self._probation[stamp_ns] = estimate
        if estimate.status.state is not State.PROBATION:
            if estimate.status.state is State.TRACKING:  # a probation that ended well was no failure of the map
                self._count_shown()
            self._probation.clear()
        small = sphere_to_message(coarse_sphere(sphere), SPHERE_FRAME, seen.number)
        self._small.keep(serialize_to_store(small))

    def lacking(self, stamp_ns: int) -> float:
        """Return the share 0...1 of a sphere of the drive that the map does not show.

        One minus the correlation in TRACKING, and in a probation that led to it; else 1. A sphere is tracked all around
        in a light in which one camera is lost, as in snow: that it is tracked does not say what a camera will find.
        """
        return self._seen[stamp_ns].lack if stamp_ns in self._seen else 1.0

    def images(self) -> list[DriveSphere]:
        """Return the spheres of the drive that were placed in it."""
        return [
            DriveSphere(track, seen.found, partial(self._small.__getitem__, seen.number))
            for track in self.tracks
            if (seen := self._seen.get(track.stamp_ns)) is not None
        ]

    def unexplained(self) -> set[int]:
        """Return the key spheres of the drive most of whose images the map did not explain.

        A sphere sees all around: it is tracked where one camera is not. So it must resemble the map, too.
        """
        key_of = {track.stamp_ns: track.key_id for track in self.tracks}
        key_of |= {node.stamp_ns: node.id for node in self.graph}
        told = defaultdict[int, list[bool]](list)
        for stamp_ns in self._seen.keys() & key_of.keys():
            told[key_of[stamp_ns]].append(self._seen[stamp_ns].is_explained)
        return {key_id for key_id, images in told.items() if np.mean(images) < MIN_EXPLAINED_SHARE}

    def _count_shown(self) -> None:
        """Note what the map shows of the spheres of a probation that ended, and of the one that ended it.

        Those of the probation served, too: else what a map holds of the place where drives begin would never count.
        """
        for stamp_ns, estimate in self._probation.items():
            if estimate.status.references:
                count_image(self.served, int(estimate.status.references[0]), stamp_ns)
            ncc = estimate.candidate.ncc if estimate.candidate is not None else 0.0
            self._seen[stamp_ns].lack = 1.0 - max(ncc, 0.0)
            self._seen[stamp_ns].is_explained = is_alike(estimate)

    def _odometry(self, update: MapUpdate) -> SE3 | None:
        """Return the pose of a sphere in a frame that loops do not move: by the motion since the one before."""
        if update.T_map_sphere is None:
            return None
        latest = [self.graph[track.key_id].T_map_sphere @ track.T_key_sphere for track in self.tracks[-2:]]
        self._T_odom_sphere = self._T_odom_sphere @ latest[0].inverse() @ latest[-1]
        return self._T_odom_sphere

    def _locate(self, estimate: CameraEstimate) -> Localized | None:
        status = estimate.status
        if estimate.T_map_camera is None or estimate.covariance is None or not status.references:
            return None
        a = int(status.references[0])
        T_a_sphere = self.base.graph[a].T_map_sphere.inverse() @ estimate.T_map_camera
        return Localized(a, T_a_sphere, estimate.covariance, is_sure=status.state is State.TRACKING)


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
