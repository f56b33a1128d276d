"""KITTI odometry: a rectified grey (or colour) stereo pair, calibration, times and poses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.files.untrusted import number
from sphere_nav_tools.offline.constants import DEFAULT_HZ
from sphere_nav_tools.offline.importing.recording import (
    FIRST_STAMP_NS,
    Instant,
    Recording,
    body_from_optical,
    image_shot,
    pair_views,
    read_image,
    read_numbers,
    read_rows,
    require_folder,
)

FOLDERS = {("image_0", "image_1"): (0, 1), ("image_l", "image_r"): (0, 1), ("image_2", "image_3"): (2, 3)}  # P of calib


def open_kitti(folder: Path) -> Recording:
    """Open a sequence: calib.txt, two folders of images, and times.txt and poses.txt where they are there."""
    require_folder(folder)
    names = next((names for names in FOLDERS if (folder / names[0]).is_dir()), None)
    if names is None:
        raise ValueError(f"{folder / 'image_0'}: expected a folder of images, found none")
    left, right = folder / names[0], require_folder(folder / names[1])
    images = sorted(left.glob("*.png"))
    if not images:
        raise ValueError(f"{left}: expected images 000000.png and on, found none")
    first, second = FOLDERS[names]
    height, width = read_image(images[0]).shape[:2]
    P_left, P_right = (_projection(folder / "calib.txt", number) for number in (first, second))
    camera = Pinhole(width, height, P_left[0, 0], P_left[1, 1], P_left[0, 2], P_left[1, 2])
    baseline = (P_left[0, 3] - P_right[0, 3]) / P_left[0, 0]
    if not baseline > 0:
        raise ValueError(f"{folder / 'calib.txt'}: P{second}: expected a camera to the right, found {baseline} m")
    numbers = [_number(image) for image in images]
    times, poses = (
        _optional(folder / name, columns, numbers[-1]) for name, columns in (("times.txt", 1), ("poses.txt", 12))
    )
    instants = []
    for image, index in zip(images, numbers, strict=True):
        stamp = FIRST_STAMP_NS + round((index / DEFAULT_HZ if times is None else float(times[index, 0])) * 1e9)
        shots = {"left": image_shot(image, stamp), "right": image_shot(right / image.name, stamp)}
        instants.append(Instant(stamp, shots, None if poses is None else _pose(poses[index])))
    views = pair_views(camera, camera, SE3.from_parts(np.eye(3), [baseline, 0.0, 0.0]), baseline)
    return Recording(views, instants, "poses.txt")


def _pose(row: NDArray[np.float64]) -> SE3:
    """Return where the left camera's body is by 3 x 4 numbers; z of the world points ahead, as that of the camera."""
    T_world_left = SE3.from_matrix(np.vstack([row.reshape(3, 4), (0, 0, 0, 1)]))
    return body_from_optical(T_world_left, is_world_optical=True)


def _projection(path: Path, index: int) -> NDArray[np.float64]:
    """Return P<index> (3, 4) from lines 'P0: ...', or from the line of that number where they carry no names."""
    lines = [line.split() for line in read_rows(path, "calibration of KITTI")]
    named = {words[0].rstrip(":"): words[1:] for words in lines if words[0].endswith(":")}
    words = named.get(f"P{index}") if named else lines[index] if index < len(lines) else None
    if words is None or len(words) != 12:
        raise ValueError(f"{path}: P{index}: expected 12 numbers, found {len(words or ())}")
    return np.array([number(word, f"{path}: P{index}") for word in words]).reshape(3, 4)


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
