"""`learn`: the key images of a drive, in a bag beside the map; `sphere_nav map-learn` makes a new map of it.

`<map>.drives/<day and time of the first image>` holds for each key image its camera, where that was in the map,
whether the map explained it, the status, and the image. A drive that ends has its name; what a killed one has left is
`<name>.partial`, and is not used. Another thread writes: no image waits for the disk, which may take 0.3 s. A drive
takes MAX_DRIVE_MB at most, all drives together MAX_DRIVES_MB: the oldest ones go.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from datetime import UTC, datetime
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from std_msgs.msg import Bool

from dense_localizer.constants import MIN_KEY_IMAGES
from dense_localizer.inputs import CameraImage
from dense_localizer.judge.estimate import CameraEstimate
from dense_localizer.key_images import KeyImages, is_explained, is_lesson
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.ros import conversions
from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.bags.writer import PARTIAL, BagWriter, free_path
from sphere_nav.ros.maps.reader import MapReader
from sphere_nav.ros.service import one_line

DRIVES = ".drives"  # ends the name of the folder beside a map
MAX_DRIVE_MB, MAX_DRIVES_MB = 500.0, 5000.0
STATUS, EXPLAINED, POSE = "/status", "/explained", "/camera_pose"
IMAGE, INFO, SPHERE_INFO = "/image_raw", "/camera_info", "/sphere_info"
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
        self._pending: Future[None] | None = None
        self._bag: BagWriter | None = None
        self._is_over = False  # full, or the disk is

    def see(self, images: Sequence[CameraImage], estimate: CameraEstimate) -> None:
        """Keep what was made of the images of an instant, if they are key images and the disk is ready."""
        is_late = self._is_live and self._pending is not None and not self._pending.done()
        if self._is_over or is_late or not self._chosen.choose(estimate):
            return
        kept = [replace(one, image=in_bytes(one.image)) for one in images]
        self._pending = self._pool.submit(self._write, kept, estimate)
        if not self._is_live:
            self._pending.result()

    def close(self) -> None:
        """End the drive: give it its name, or drop it where it shows nothing."""
        self._pool.submit(self._finish).result()
        self._pool.shutdown()

    def _write(self, images: list[CameraImage], estimate: CameraEstimate) -> None:
        stamp = estimate.status.stamp_ns
        try:
            if self._bag is None:
                name = datetime.fromtimestamp(stamp * 1e-9, UTC).strftime("%Y%m%d_%H%M%S")
                self._bag = BagWriter(free_path(self._folder / name))
            for one in images:
                for topic, message in self._messages(one, estimate):
                    self._bag.write(topic, message, stamp)
            self._explained.append(is_explained(estimate))
            if self._bag.position > MAX_DRIVE_MB * 1e6:
                self._stop(f"{self._bag.path}: {MAX_DRIVE_MB:.0f} MB: the rest of the drive is not kept")
        except (ValueError, OSError) as error:
            self._stop(f"learn: {one_line(error)}: the rest of the drive is not kept")

    def _messages(self, one: CameraImage, estimate: CameraEstimate) -> Iterator[tuple[str, Any]]:
        """Yield topics and messages of one image: its camera, by the pose of its body, and last of all the image."""
        stamp, covariance = estimate.status.stamp_ns, estimate.covariance
        assert estimate.T_map_camera is not None  # key images were placed
        assert covariance is not None
        T_body_camera = one.T_body_camera or SE3.identity()
        Ad = T_body_camera.inverse().adjoint()
        if isinstance(one.camera, Spherical):
            yield SPHERE_INFO, conversions.camera_to_sphere_info(one.camera, FRAME)
        else:
            yield INFO, conversions.camera_to_info(one.camera, stamp, FRAME)
        told = estimate.T_map_camera @ T_body_camera, Ad @ covariance @ Ad.T, stamp, self._frame
        yield POSE, conversions.se3_to_pose_with_covariance(*told)
        yield EXPLAINED, Bool(data=is_explained(estimate))
        status = replace(estimate.status, map_id=self._map_id)
        yield STATUS, conversions.status_to_message(status, stamp, self._frame)
        yield IMAGE, conversions.array_to_image(one.image, stamp, FRAME, "mono8")

    def _stop(self, line: str) -> None:
        self._is_over = True
        self._log(line)

    def _finish(self) -> None:
        if self._bag is None:
            return
        try:
            if len(self._explained) < MIN_KEY_IMAGES:
                self._bag.discard()
                return
            path = self._bag.close()
            prune(self._folder)
        except (BagError, OSError) as error:
            self._bag.leave()
            self._log(f"learn: {one_line(error)}")
            return
        is_new = is_lesson(self._explained)
        advice = f": sphere_nav map-learn {self._folder.with_suffix('')} learns from it" if is_new else ""
        self._log(f"{path}: the map explained {sum(self._explained)} of {len(self._explained)} key images{advice}")


def in_bytes(image: NDArray[Any]) -> NDArray[np.uint8]:
    """Return a copy of a grey image (H, W) with levels 0...255 in bytes."""
    return image.copy() if image.dtype == np.uint8 else np.clip(np.rint(image), 0, 255).astype(np.uint8)


def prune(folder: Path) -> None:
    """Delete the oldest drives where all together take too much."""
    drives = sorted(
        (one for one in folder.iterdir() if one.suffix != PARTIAL), key=lambda one: one.stat().st_mtime, reverse=True
    )
    sizes = accumulate(sum(file.stat().st_size for file in one.iterdir()) for one in drives)
    for drive in [one for one, size in zip(drives, sizes, strict=True) if size > MAX_DRIVES_MB * 1e6]:
        shutil.rmtree(drive, ignore_errors=True)
