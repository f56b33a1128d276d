"""KITTI odometry: a rectified grey (or colour) stereo pair, calibration, times and poses."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from numpy.typing import NDArray

from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.files.untrusted import number as number_of
from sphere_nav.geometry.files.untrusted import read_text
from sphere_nav.ros.conversions import array_to_image, camera_to_info, se3_to_pose_stamped
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav_tools.offline.constants import DEFAULT_HZ
from sphere_nav_tools.offline.importing.recording import (
    FIRST_STAMP_NS,
    MAP_FRAME,
    body_from_optical,
    camera_transforms,
    read_image,
    read_numbers,
    require_folder,
)

FOLDERS = (("image_0", "image_1"), ("image_l", "image_r"), ("image_2", "image_3"))
CAMERAS = {"image_0": (0, 1), "image_l": (0, 1), "image_2": (2, 3)}
LEFT_FRAME, RIGHT_FRAME = "left_optical", "right_optical"


class KittiRecording:
    """A folder of one sequence: calib.txt, two folders of images, and times.txt and poses.txt where they are there."""

    def __init__(self, folder: Path) -> None:
        self.folder = require_folder(folder)
        self.left, self.right = _image_folders(folder)
        self.images = sorted(self.left.glob("*.png"))
        if not self.images:
            raise ValueError(f"{self.left}: expected images 000000.png and on, found none")
        self.num_frames = len(self.images)
        first, second = CAMERAS[self.left.name]
        height, width = read_image(self.images[0]).shape[:2]
        P_left, P_right = (_projection(folder / "calib.txt", number) for number in (first, second))
        self.camera = Pinhole(width, height, P_left[0, 0], P_left[1, 1], P_left[0, 2], P_left[1, 2])
        self.baseline = (P_left[0, 3] - P_right[0, 3]) / P_left[0, 0]
        if not self.baseline > 0:
            raise ValueError(
                f"{folder / 'calib.txt'}: P{second}: expected a camera to the right, found {self.baseline} m"
            )
        self.times = _optional(folder / "times.txt", 1, self._last)
        self.poses = _optional(folder / "poses.txt", 12, self._last)
        self.truth_name = "poses.txt" if self.poses is not None else ""

    @property
    def _last(self) -> int:
        return _number(self.images[-1])

    def static_transforms(self, stamp: int) -> list[TransformStamped]:
        """Return base_link -> camera_link -> left_optical, right_optical."""
        T_camera_right = T_BODY_OPTICAL @ SE3.from_parts(np.eye(3), [self.baseline, 0.0, 0.0])
        return camera_transforms(stamp, {LEFT_FRAME: T_BODY_OPTICAL, RIGHT_FRAME: T_camera_right})

    def stamp_ns(self, index: int) -> int:
        """Return the stamp of a frame."""
        number = _number(self.images[index])
        seconds = number / DEFAULT_HZ if self.times is None else float(self.times[number, 0])
        return FIRST_STAMP_NS + round(seconds * 1e9)

    def frame(self, index: int) -> Iterator[tuple[str, Any]]:
        """Yield both images with their camera_info, and the true pose where it is known."""
        stamp, path = self.stamp_ns(index), self.images[index]
        if self.poses is not None:
            T_world_left = SE3.from_matrix(np.vstack([self.poses[_number(path)].reshape(3, 4), (0, 0, 0, 1)]))
            T_map_body = body_from_optical(T_world_left, is_world_optical=True)
            yield "ground_truth/pose", se3_to_pose_stamped(T_map_body, stamp, MAP_FRAME)
        yield "left/camera_info", camera_to_info(self.camera, stamp, LEFT_FRAME)
        yield "right/camera_info", camera_to_info(self.camera, stamp, RIGHT_FRAME, baseline=self.baseline)
        for side, file, frame_id in (("left", path, LEFT_FRAME), ("right", self.right / path.name, RIGHT_FRAME)):
            image = read_image(file)
            if image.shape[1::-1] != (self.camera.width, self.camera.height):
                expected = f"{self.camera.width} x {self.camera.height}"
                raise ValueError(f"{file}: expected {expected} pixels, found {image.shape[1]} x {image.shape[0]}")
            yield f"{side}/image_raw", array_to_image(image, stamp, frame_id, "bgr8" if image.ndim == 3 else "mono8")


def _image_folders(folder: Path) -> tuple[Path, Path]:
    for left, right in FOLDERS:
        if (folder / left).is_dir():
            return folder / left, require_folder(folder / right)
    raise ValueError(f"{folder / FOLDERS[0][0]}: expected a folder of images, found none")


def _projection(path: Path, number: int) -> NDArray[np.float64]:
    """Return P<number> (3, 4) from lines 'P0: ...', or from the line of that number where they carry no names."""
    lines = [line.split() for line in read_text(path, "calibration of KITTI").split("\n") if line.strip()]
    named = {words[0].rstrip(":"): words[1:] for words in lines if words[0].endswith(":")}
    words = named.get(f"P{number}") if named else lines[number] if number < len(lines) else None
    if words is None or len(words) != 12:
        raise ValueError(f"{path}: P{number}: expected 12 numbers, found {len(words or ())}")
    return np.array([number_of(word, f"{path}: P{number}") for word in words]).reshape(3, 4)


def _optional(path: Path, columns: int, last: int) -> NDArray[np.float64] | None:
    if not path.is_file():
        return None
    table = read_numbers(path, columns)
    if len(table) <= last:
        raise ValueError(f"{path}: expected at least {last + 1} rows (image {last:06d}), found {len(table)}")
    return table


def _number(path: Path) -> int:
    if not path.stem.isdigit():
        raise ValueError(f"{path}: expected a number as name, found {path.stem!r}")
    return int(path.stem)
