"""One segment of a drive -> a map of its own and a record of what is no part of it; a worker reads the bag itself."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sphere_mapping.graph.keyframes import Track
from sphere_mapping.mapper import Mapper
from sphere_mapping.params import MapperParams
from sphere_mapping.ros.mount import CameraMount
from sphere_nav.geometry import SE3
from sphere_nav.geometry.files.untrusted import load_json, numbers, read_text, required
from sphere_nav.geometry.files.whole_file import write_whole
from sphere_nav.ros.maps.writer import MapWriter
from sphere_nav_tools.offline.mapping.replay_mapper import Recipe, replay_mapper
from sphere_nav_tools.offline.mapping.segments import DriveSegment
from sphere_nav_tools.offline.mapping.workers import limit_threads

_ALONE = threading.Lock()  # kernels and file handles of a process serve one segment at a time


@dataclass(frozen=True, eq=False)
class SegmentTask:
    """A segment to map into a folder; `is_shown`: with a bar."""

    recipe: Recipe
    segment: DriveSegment
    folder: Path
    is_shown: bool = False


@dataclass(eq=False)
class SegmentRecord:
    """What a segment's map does not hold: its tracks by ids of that map, what was lost and refused, and the mount.

    refused: how often, by the words with {n} in the place of the number.
    """

    tracks: list[Track] = field(default_factory=list)
    num_lost: int = 0
    num_loops: int = 0
    refused: dict[str, int] = field(default_factory=dict)
    damages: list[str] = field(default_factory=list)
    mount: CameraMount = field(default_factory=lambda: CameraMount("", False, SE3.identity()))
    origin: str = ""


def write_record(path: Path, record: SegmentRecord) -> None:
    """Write a record; it is there as a whole or not at all."""
    mount = record.mount
    content = {
        "stamps": [track.stamp_ns for track in record.tracks],
        "keys": [track.key_id for track in record.tracks],
        "poses": [track.T_key_sphere.matrix.ravel().tolist() for track in record.tracks],
        "counts": [record.num_lost, record.num_loops],
        "refused": record.refused,
        "damages": record.damages,
        "mount": [mount.frame_id, mount.is_optical],
        "mount_poses": [T.matrix.ravel().tolist() for T in (mount.T_base_body, mount.T_sphere_body)],
        "origin": record.origin,
    }
    write_json(path, content)


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write values; the file is there as a whole or not at all."""
    write_whole(path, json.dumps(content))


def read_record(path: Path) -> SegmentRecord:
    """Read a record; ValueError in one line where it is none."""
    fields = "stamps", "keys", "poses", "counts", "refused", "damages", "mount", "mount_poses", "origin"
    found = required(load_json(path, read_text(path, "record of a segment")), str(path), fields)
    try:
        poses = [_pose(one, f"{path}.poses") for one in found["poses"]]
        stamps, keys = map(int, found["stamps"]), map(int, found["keys"])
        tracks = [Track(*one) for one in zip(stamps, keys, poses, strict=True)]
        (frame_id, is_optical), mounts = found["mount"], [_pose(one, str(path)) for one in found["mount_poses"]]
        mount, (num_lost, num_loops) = CameraMount(str(frame_id), bool(is_optical), *mounts), map(int, found["counts"])
        refused = {str(words): int(number) for words, number in found["refused"].items()}
        damages = list(map(str, found["damages"]))
        return SegmentRecord(tracks, num_lost, num_loops, refused, damages, mount, str(found["origin"]))
    except (TypeError, AttributeError) as error:
        raise ValueError(f"{path}: expected a record of a segment, found another file ({error})") from None


def map_segment(task: SegmentTask, make: Callable[..., Mapper] = Mapper) -> None:
    """Map a segment by what `make` returns: its map appears in the folder, if it has key spheres, then its record."""
    name = task.segment.name
    with _ALONE:
        if not task.is_shown:
            limit_threads()
        writer = MapWriter(task.folder / name, task.recipe.details)

        def begin(params: MapperParams) -> Mapper:
            return make(params, store=writer)

        try:
            drive = replay_mapper(task.recipe, begin, task.segment, is_shown=task.is_shown)
            mapper = drive.mapper
            mapper.keep_end(is_near=not task.segment.is_last)
            if len(mapper.graph):
                writer.finish(mapper.graph, replace(task.recipe.details, map_id=name), mapper.appearance)
            else:
                writer.discard()
        finally:
            writer.leave()
    record = SegmentRecord(
        mapper.tracks, drive.num_lost, mapper.num_loops, drive.refused, drive.damages, drive.mount, mapper.origin
    )
    write_record(task.folder / f"{name}.json", record)


def _pose(found: Any, where: str) -> SE3:
    return SE3.from_matrix(np.reshape(numbers(found, where, 16), (4, 4)))
