"""`learn`: the key images of a drive, in a bag beside the map; `sphere_nav map-learn` makes a new map of it.

`<map>.drives/<day and time of the first image>` holds for each key image the image, its camera, where that was in the
map, whether the map explained it, and the status. A drive that ends has its name; what a killed one has left is
`<name>.partial`, and is not used. Another thread writes: no image waits for the disk. A drive takes
MAX_DRIVE_MB at most, all drives together MAX_DRIVES_MB: the oldest ones go.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from std_msgs.msg import Bool

from dense_localizer.inputs import CameraImage
from dense_localizer.judge.estimate import CameraEstimate
from dense_localizer.key_images import Explanation, KeyImages, is_explained
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.geometry.arrays import Array
from sphere_nav.ros import conversions
from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.bags.writer import PARTIAL, BagWriter
from sphere_nav.ros.maps.reader import MapReader
from sphere_nav.ros.service import one_line

DRIVES = ".drives"  # ends the name of the folder beside a map
MAX_DRIVE_MB, MAX_DRIVES_MB = 500.0, 5000.0
MAX_PENDING = 8  # key images that wait for the disk
STATUS, EXPLAINED = "/status", "/explained"
IMAGE, INFO, SPHERE_INFO, POSE = "image_raw", "camera_info", "sphere_info", "camera_pose"
FRAME = "camera"


def drives_of(map_path: Path) -> Path:
    """Return the folder of the drives that are kept beside a map."""
    folder = (map_path if map_path.is_dir() else map_path.parent).resolve()
    return folder.with_name(folder.name + DRIVES)


class DriveRecorder:
    """One drive in one map."""

    def __init__(self, reader: MapReader, log: Callable[[str], object], *, is_live: bool):
        """`log` takes a line for the user. A drive that is not live, of a bag, waits for the disk."""
        self._folder, self._map_id = drives_of(reader.path), str(reader.info.map_id)
        self._frame = str(reader.info.header.frame_id)
        self._log, self._is_live = log, is_live
        self._chosen, self._explained = KeyImages(), list[bool]()
        self._pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="drive")
        self._pending: list[Future[None]] = []
        self._bag: BagWriter | None = None
        self._is_over = False  # full, or the disk is

    def see(self, images: Sequence[CameraImage], estimate: CameraEstimate) -> None:
        """Keep what was made of the images of an instant, if they are key images."""
        self._pending = [one for one in self._pending if not one.done()]
        is_late = self._is_live and len(self._pending) >= MAX_PENDING
        if self._is_over or is_late or not self._chosen.choose(estimate):
            return
        self._explained.append(is_explained(estimate))
        kept = [CameraImage(in_bytes(one.image), one.camera, one.T_body_camera, one.name) for one in images]
        self._pending.append(self._pool.submit(self._write, kept, estimate))
        if not self._is_live:
            self._pending[-1].result()

    def close(self) -> None:
        """End the drive: give it its name, or drop it where it shows nothing."""
        self._pool.submit(self._finish).result()
        self._pool.shutdown()

    def _write(self, images: list[CameraImage], estimate: CameraEstimate) -> None:
        stamp, covariance = estimate.status.stamp_ns, estimate.covariance
        if self._is_over or estimate.T_map_camera is None or covariance is None:
            return
        try:
            bag = self._bag = self._bag or self._begin(stamp)
            for one in images:
                self._write_image(bag, one, estimate.T_map_camera, covariance, stamp)
            bag.write(EXPLAINED, Bool(data=is_explained(estimate)), stamp)
            status = replace(estimate.status, map_id=self._map_id)
            bag.write(STATUS, conversions.status_to_message(status, stamp, self._frame), stamp)
            if bag.position > MAX_DRIVE_MB * 1e6:
                self._stop(f"{bag.path}: {MAX_DRIVE_MB:.0f} MB: the rest of the drive is not kept")
        except (ValueError, OSError) as error:
            self._stop(f"learn: {one_line(error)}: the rest of the drive is not kept")

    def _begin(self, stamp_ns: int) -> BagWriter:
        name = datetime.fromtimestamp(stamp_ns * 1e-9, UTC).strftime("%Y%m%d_%H%M%S")
        return BagWriter.at_free_path(self._folder / name)

    def _write_image(self, bag: BagWriter, one: CameraImage, T_map_body: SE3, covariance: Array, stamp: int) -> None:
        """Write one image, and where its camera was, by the pose of its body with its covariance (6, 6)."""
        prefix = f"/cameras/{one.name}/" if one.name else "/"
        T_body_camera = one.T_body_camera or SE3.identity()
        T_map_camera, Ad = T_map_body @ T_body_camera, T_body_camera.inverse().adjoint()
        if isinstance(one.camera, Spherical):
            bag.write(prefix + SPHERE_INFO, conversions.camera_to_sphere_info(one.camera, FRAME), stamp)
        else:
            bag.write(prefix + INFO, conversions.camera_to_info(one.camera, stamp, FRAME), stamp)
        told = T_map_camera, Ad @ covariance @ Ad.T, stamp, self._frame
        bag.write(prefix + POSE, conversions.se3_to_pose_with_covariance(*told), stamp)
        bag.write(prefix + IMAGE, conversions.array_to_image(one.image, stamp, FRAME, "mono8"), stamp)

    def _stop(self, line: str) -> None:
        self._is_over = True
        self._log(line)

    def _finish(self) -> None:
        if self._bag is None:
            return
        bag, told = self._bag, Explanation.of(self._explained)
        try:
            if not told.is_enough:
                bag.discard()
                return
            path = bag.close()
            prune(self._folder)
        except (BagError, OSError) as error:
            bag.leave()
            self._log(f"learn: {one_line(error)}")
            return
        advice = f": sphere_nav map-learn {self._folder.with_suffix('')} learns from it" if told.is_lesson else ""
        self._log(f"{path}: the map explained {told.num_explained} of {told.num_images} key images{advice}")


def in_bytes(image: NDArray[Any]) -> NDArray[np.uint8]:
    """Return a copy of a grey image (H, W) with levels 0...255 in bytes."""
    return image.copy() if image.dtype == np.uint8 else np.clip(np.rint(image), 0, 255).astype(np.uint8)


def prune(folder: Path) -> None:
    """Delete the oldest drives where all together take too much."""
    drives = sorted((one for one in folder.iterdir() if one.is_dir() and one.suffix != PARTIAL), key=_ended)
    sizes = {one: sum(file.stat().st_size for file in one.iterdir()) for one in drives}
    while sum(sizes.values()) > MAX_DRIVES_MB * 1e6 and len(sizes) > 1:
        oldest = next(iter(sizes))
        shutil.rmtree(oldest, ignore_errors=True)
        del sizes[oldest]


def _ended(drive: Path) -> float:
    return drive.stat().st_mtime
