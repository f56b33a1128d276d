"""What every data set offers to the importer, and the files that most of them are made of."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
from geometry_msgs.msg import TransformStamped
from numpy.typing import NDArray

from sphere_nav.geometry import SE3
from sphere_nav.geometry.files.encoded import read_image_file
from sphere_nav.geometry.files.untrusted import number, read_text
from sphere_nav.geometry.trajectory import NORM_TOLERANCE
from sphere_nav.ros.conversions import se3_to_transform
from sphere_nav.ros.conversions.stamps import SECOND
from sphere_nav.spheres.sphere import T_BODY_OPTICAL

FIRST_STAMP_NS = SECOND  # of recordings that start at zero: stamp 0 means 'no stamp'
MAP_FRAME, BASE_FRAME, CAMERA_FRAME, OPTICAL_FRAME = "map", "base_link", "camera_link", "camera_optical"


class Recording(Protocol):
    """A data set, frame by frame."""

    num_frames: int
    truth_name: str  # where the truth comes from; empty where there is none

    def static_transforms(self, stamp: int) -> list[TransformStamped]:
        """Return what `/tf_static` says."""
        ...

    def stamp_ns(self, index: int) -> int:
        """Return the stamp of a frame."""
        ...

    def frame(self, index: int) -> Iterator[tuple[str, Any]]:
        """Yield topic and message of everything that was recorded at one instant."""
        ...


def body_from_optical(T_world_optical: SE3, *, is_world_optical: bool) -> SE3:
    """Return T_map_body of a camera pose; a world with optical axes is turned to body axes."""
    T_map_optical = T_BODY_OPTICAL @ T_world_optical if is_world_optical else T_world_optical
    return T_map_optical @ T_BODY_OPTICAL.inverse()


def camera_transforms(stamp: int, cameras: dict[str, SE3], T_base_camera: SE3 | None = None) -> list[TransformStamped]:
    """Return base_link -> camera_link (identity) -> the optical frames, whose poses T_camera_optical are given."""
    frames = [se3_to_transform(T_base_camera or SE3.identity(), stamp, BASE_FRAME, CAMERA_FRAME)]
    return frames + [se3_to_transform(T, stamp, CAMERA_FRAME, name) for name, T in cameras.items()]


def read_image(path: Path) -> NDArray[Any]:
    """Return an 8-bit image (H, W) grey or (H, W, 3) BGR."""
    return _decode(path, cv2.IMREAD_ANYCOLOR, np.uint8)


def read_depth_file(path: Path) -> NDArray[np.uint16]:
    """Return a 16-bit image (H, W)."""
    pixels = _decode(path, cv2.IMREAD_UNCHANGED, np.uint16)
    if pixels.ndim != 2:
        raise ValueError(f"{path}: expected one channel, found {pixels.shape[2]}")
    return pixels


def read_numbers(path: Path, columns: int) -> NDArray[np.float64]:
    """Return the table (N, columns) of a text file; `#` begins a comment."""
    table = []
    for line, text in enumerate(read_text(path, "table of numbers").split("\n"), start=1):
        words = text.split("#")[0].replace(",", " ").split()
        if words and len(words) != columns:
            raise ValueError(f"{path}:{line}: expected {columns} numbers, found {len(words)}")
        if words:
            table.append([number(word, f"{path}:{line}") for word in words])
    return np.array(table, dtype=np.float64).reshape(-1, columns)


def read_pose(path: Path) -> SE3:
    """Return a pose from a file with a 4 x 4 matrix."""
    table = read_numbers(path, 4)
    if table.shape != (4, 4):
        raise ValueError(f"{path}: expected 4 x 4 numbers, found {table.shape[0]} x {table.shape[1]}")
    try:
        return SE3.from_matrix(table, tolerance=2e-3)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def pose_of_row(row: NDArray[np.float64], where: Path) -> SE3:
    """Return the pose of x y z qx qy qz qw (7,)."""
    if abs(np.linalg.norm(row[3:]) - 1.0) > NORM_TOLERANCE:
        raise ValueError(f"{where}: expected unit quaternions, found {row[3:].tolist()}")
    return SE3.from_quaternion(row[3:], row[:3])


def require_folder(path: Path) -> Path:
    """Return the folder; ValueError if there is none."""
    if not path.is_dir():
        raise ValueError(f"{path}: expected a folder, found {'a file' if path.exists() else 'none'}")
    return path


def _decode(path: Path, mode: int, kind: type) -> NDArray[Any]:
    pixels = read_image_file(path, mode)
    if pixels.dtype != kind:
        raise ValueError(f"{path}: expected {np.dtype(kind)} pixels, found {pixels.dtype}")
    return pixels
