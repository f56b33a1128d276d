"""The drives that `learn` has kept beside a map, read back."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dense_localizer.constants import MIN_EXPLAINED_NCC
from dense_localizer.key_images import Explanation
from dense_localizer.references.rejections import Rejections, read_rejections
from dense_localizer.ros.drive_recorder import (
    IMAGE,
    INFO,
    LIKENESS,
    POSE,
    REJECTIONS,
    SPHERE_INFO,
    STATUS,
    drives_of,
)
from sphere_nav.geometry import SE3, Camera
from sphere_nav.geometry.arrays import Array
from sphere_nav.localization.status import State
from sphere_nav.ros import conversions
from sphere_nav.ros.bags import BagReader
from sphere_nav.ros.bags.check import SALVAGING, salvage
from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.bags.writer import PARTIAL, is_being_written

REFUSED = ".refused"  # ends the name of a drive that made the map worse, or that was taken back


@dataclass(frozen=True, eq=False)
class KeyImage:
    """An image of one camera, where it was in the map with its covariance (6, 6), and what the map was to it."""

    stamp_ns: int
    image: NDArray[np.uint8]
    camera: Camera
    T_map_camera: SE3
    covariance: Array
    references: tuple[int, ...]
    is_explained: bool


class KeptDrive:
    """A drive in a folder; its images are read when they are asked for, each time anew."""

    def __init__(self, path: Path, frame_id: str) -> None:
        self.path, self._frame_id = path, frame_id

    @property
    def name(self) -> str:
        """What it is called, and the experience that it becomes."""
        return self.path.name

    @cached_property
    def _told(self) -> tuple[str, Explanation]:
        with BagReader(self.path) as bag:
            likeness = {stamp: float(item.data) for _, stamp, item in bag.messages([LIKENESS])}
            statuses = {stamp: item for _, stamp, item in bag.messages([STATUS])}
        if not statuses:
            return "", Explanation(0, 0)
        explained = (_is_explained(item.state, likeness.get(stamp, 0.0)) for stamp, item in statuses.items())
        return str(next(iter(statuses.values())).map_id), Explanation.of(explained)

    @property
    def map_id(self) -> str:
        """The map that it was driven in; empty where it shows nothing. BagError for damage."""
        return self._told[0]

    @property
    def explanation(self) -> Explanation:
        """How many instants it has, and how many of them the map explained. BagError for damage."""
        return self._told[1]

    def images(self) -> Iterator[KeyImage]:
        """Yield the images of all cameras in order of time; BagError for damage."""
        cameras: dict[str, Camera] = {}
        poses: dict[tuple[str, int], tuple[SE3, Array]] = {}
        waiting: list[tuple[str, Any]] = []
        likeness = 0.0
        with BagReader(self.path) as bag:
            for topic, stamp, message in bag.messages():
                prefix, _, kind = topic.rpartition("/")
                if kind == INFO:
                    cameras[prefix] = conversions.camera_from_info(message)
                elif kind == SPHERE_INFO:
                    cameras[prefix] = conversions.sphere_info_to_camera(message)
                elif kind == POSE:
                    poses[prefix, stamp] = conversions.pose_with_covariance_to_se3(message, self._frame_id)
                elif kind == IMAGE:
                    waiting.append((prefix, message))
                elif topic == LIKENESS:
                    likeness = float(message.data)
                elif topic == STATUS:  # the last of an instant
                    status = conversions.message_to_status(message)
                    is_explained = _is_explained(status.state, likeness)
                    for camera, image in waiting:
                        gray = conversions.image_to_array(image).copy()
                        pose = poses[camera, stamp]
                        yield KeyImage(stamp, gray, cameras[camera], *pose, status.references, is_explained)
                    waiting.clear()
                    poses.clear()

    def rejections(self, map_id: str) -> Rejections:
        """Return what its images contradicted in a map; nothing where that was not written, or of another map."""
        path = self.path / REJECTIONS
        return read_rejections(path, map_id) if path.is_file() else Rejections()

    def refuse(self) -> None:
        """Learn from it no more, and do not judge by it; an earlier one of its name that was refused stays too."""
        names = (self.name if number == 1 else f"{self.name}-{number}" for number in count(1))
        paths = (self.path.with_name(name + REFUSED) for name in names)
        self.path.rename(next(path for path in paths if not path.exists()))


def find_drives(map_path: Path, frame_id: str) -> list[KeptDrive]:
    """Return the drives beside a map, the oldest first; what a killed drive has left is mended before."""
    folder = drives_of(map_path)
    if not folder.is_dir():
        return []
    for torn in sorted(folder.glob(f"*{PARTIAL}")):
        target = torn.with_name(torn.name.removesuffix(PARTIAL))
        if not is_being_written(torn) and not target.exists():
            shutil.rmtree(target.with_name(target.name + SALVAGING), ignore_errors=True)
            with suppress(BagError):  # nothing of it can be read
                salvage(torn, target)
            shutil.rmtree(torn, ignore_errors=True)
    others = REFUSED, PARTIAL, SALVAGING
    paths = sorted(one for one in folder.iterdir() if one.is_dir() and not one.name.endswith(others))
    return [KeptDrive(one, frame_id) for one in paths]


def _is_explained(state: str, likeness: float) -> bool:
    return state == State.TRACKING and likeness >= MIN_EXPLAINED_NCC
