"""What every data set offers to the importer, and the files that most of them are made of."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
from geometry_msgs.msg import TransformStamped
from numpy.typing import NDArray

from node_kit.conversions import se3_to_transform
from sphere_geometry import SE3
from sphere_map.sphere import T_BODY_OPTICAL

FIRST_STAMP_NS = 1_000_000_000  # of recordings that start at zero: stamp 0 means 'no stamp'
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


def camera_transforms(stamp: int, cameras: dict[str, SE3]) -> list[TransformStamped]:
    """Return base_link -> camera_link (identity) -> the optical frames, whose poses T_camera_optical are given."""
    frames = [se3_to_transform(SE3.identity(), stamp, BASE_FRAME, CAMERA_FRAME)]
    return frames + [se3_to_transform(T, stamp, CAMERA_FRAME, name) for name, T in cameras.items()]


def read_image(path: Path) -> NDArray[Any]:
    """Return an 8-bit image (H, W) grey or (H, W, 3) BGR."""
    return _decoded(path, cv2.IMREAD_ANYCOLOR, np.uint8)


def read_depth(path: Path) -> NDArray[np.uint16]:
    """Return a 16-bit image (H, W)."""
    return _decoded(path, cv2.IMREAD_UNCHANGED, np.uint16)


def read_numbers(path: Path, columns: int) -> NDArray[np.float64]:
    """Return the table (N, columns) of a text file; `#` begins a comment."""
    lines = [line.split("#")[0].replace(",", " ").split() for line in read_text(path).splitlines()]
    try:
        table = [[float(word) for word in words] for words in lines if words]
    except ValueError as error:
        raise ValueError(f"{path}: expected numbers: {error}") from None
    for number, row in enumerate(table, start=1):
        if len(row) != columns:
            raise ValueError(f"{path}: row {number}: expected {columns} numbers, found {len(row)}")
    return np.array(table, dtype=np.float64).reshape(-1, columns)


def read_text(path: Path) -> str:
    """Return the text of a file."""
    try:
        return path.read_text()
    except FileNotFoundError:
        raise ValueError(f"{path}: expected a file, found none") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: expected a text file: {error}") from None


def read_pose(path: Path) -> SE3:
    """Return a pose from a file with a 4 x 4 matrix."""
    table = read_numbers(path, 4)
    if table.shape != (4, 4):
        raise ValueError(f"{path}: expected 4 x 4 numbers, found {table.shape[0]} x {table.shape[1]}")
    try:
        return SE3.from_matrix(table, tolerance=2e-3)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def require_folder(path: Path) -> Path:
    """Return the folder; ValueError if there is none."""
    if not path.is_dir():
        raise ValueError(f"{path}: expected a folder, found {'a file' if path.exists() else 'none'}")
    return path


def _decoded(path: Path, mode: int, kind: type) -> NDArray[Any]:
    if not path.is_file():
        raise ValueError(f"{path}: expected an image file, found none")
    pixels = cv2.imdecode(np.fromfile(path, np.uint8), mode)
    if pixels is None:
        raise ValueError(f"{path}: expected an image, found {path.stat().st_size} bytes that do not decode")
    if pixels.dtype != kind:
        raise ValueError(f"{path}: expected {np.dtype(kind)} pixels, found {pixels.dtype}")
    return pixels
