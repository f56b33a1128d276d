"""The files that most data sets are made of: images, depth, tables of numbers, poses."""

from __future__ import annotations

from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import SE3, Camera, Pinhole
from sphere_nav.geometry.arrays import Array, Bytes, Floats, Size
from sphere_nav.geometry.files.encoded import read_image_file
from sphere_nav.geometry.files.untrusted import (
    MAX_NUMBER,
    MAX_TABLE_BYTES,
    number,
    printable,
    read_text,
    short,
    told_at,
)
from sphere_nav.geometry.trajectory import NORM_TOLERANCE, Trajectory


@dataclass(frozen=True)
class Matrix:
    """A matrix as OpenCV writes it, row by row."""

    data: tuple[float, ...]


def pinhole(size: Size, lens: tuple[float, ...]) -> Pinhole:
    """Return the camera of a size (width, height) by its lens: fx, fy, cx, cy and the distortion."""
    fx, fy, cx, cy, *distortion = lens
    return Pinhole(*size, fx, fy, cx, cy, tuple(distortion))


def require_size(where: object, pixels: NDArray[Any], camera: Camera) -> None:
    """Raise ValueError where an image is not of the size of its camera."""
    if pixels.shape[1::-1] != (camera.width, camera.height):
        found = f"found {pixels.shape[1]} x {pixels.shape[0]}"
        raise ValueError(f"{where}: expected {camera.width} x {camera.height} pixels, {found}")


def read_image(path: Path, mode: int = cv2.IMREAD_ANYCOLOR, kind: type = np.uint8) -> NDArray[Any]:
    """Return an 8-bit image (H, W) grey or (H, W, 3) BGR; or in another mode of OpenCV pixels of another kind."""
    pixels = read_image_file(path, mode)
    if pixels.dtype != kind:
        raise ValueError(f"{path}: expected {np.dtype(kind)} pixels, found {pixels.dtype}")
    return pixels


def read_rgb(path: Path) -> Bytes:
    """Return a grey (H, W) or RGB (H, W, 3) image."""
    return rgb_of(read_image(path))


def rgb_of(image: Bytes) -> Bytes:
    """Return a grey image (H, W) as it is, one of BGR (H, W, 3) as RGB."""
    return np.ascontiguousarray(image[..., ::-1]) if image.ndim == 3 else image


def read_meters(path: Path, units_per_m: float = 1000.0, far: float = np.nan) -> Floats:
    """Return depth or range (H, W) of a 16-bit image in m; 0 is unknown, 65535 `far`."""
    units = read_image(path, cv2.IMREAD_UNCHANGED, np.uint16)
    if units.ndim != 2:
        raise ValueError(f"{path}: expected one channel, found {units.shape[2]}")
    meters = units.astype(np.float32) / np.float32(units_per_m)
    meters[units == 0], meters[units == np.iinfo(np.uint16).max] = np.nan, far
    return meters


def read_words(path: Path, least: int = 1) -> list[tuple[str, list[str]]]:
    """Return the lines of a text file with where they stand, as words; `#` begins a comment. ValueError: too few."""
    lines = enumerate(read_text(path, "table").split("\n"), start=1)
    rows = [
        (f"{path}:{line}", words) for line, text in lines if (words := text.split("#")[0].replace(",", " ").split())
    ]
    for where, words in rows:
        if len(words) < least:
            raise ValueError(f"{where}: expected {least} words, found {len(words)}")
    if not rows:
        raise ValueError(f"{path}: expected a table, found an empty file")
    return rows


def read_numbers(
    path: Path,
    columns: int,
    rows: int | None = None,
    *,
    skip: int = 0,
    may_lack: bool = False,
    max_bytes: int = MAX_TABLE_BYTES,
) -> Array:
    """Return the table (rows, columns) of a text file, which may have millions of lines; `#` begins a comment.

    skip: lines of a head; may_lack: some numbers may be NaN.
    """
    text = read_text(path, "table", max_bytes).replace(",", " ")
    try:
        table = np.asarray(np.loadtxt(StringIO(text), skiprows=skip, ndmin=2), np.float64)
    except ValueError as error:
        raise ValueError(f"{path}: expected numbers, found others: {printable(str(error))[:100]}") from None
    if not table.size or table.shape != (rows or len(table), columns):
        found = f"{table.shape[0]} x {table.shape[1]}" if table.size else "an empty file"
        raise ValueError(f"{path}: expected {rows or 'N'} x {columns} numbers, found {found}")
    if not may_lack and not np.all(np.abs(table) <= MAX_NUMBER):
        raise ValueError(f"{path}: expected finite numbers up to {MAX_NUMBER:g}, found others")
    return table


def read_stamped(path: Path, count: int) -> tuple[NDArray[np.int64], Array]:
    """Return the stamps (N,) in ns and so many numbers (N, count) behind them, of all lines."""
    rows = read_words(path, count + 1)
    stamps = [whole(words[0], where) for where, words in rows]
    values = [[number(word, where) for word in words[1 : count + 1]] for where, words in rows]
    return np.array(stamps, np.int64), np.array(values)


def whole(word: str, where: str) -> int:
    """Return a whole number."""
    if not word.isdecimal():
        raise ValueError(f"{where}: expected a whole number, found {short(word)}")
    return int(word)


def read_pose(path: Path) -> SE3:
    """Return a pose from a file with a 4 x 4 matrix."""
    return pose_of_matrix(read_numbers(path, 4, 4).ravel(), path)


def pose_of_matrix(values: Any, where: Path) -> SE3:
    """Return the pose of 16 numbers, row by row; or the poses of rows of them."""
    with told_at(where):
        return SE3.from_matrix(np.reshape(values, (*np.shape(values)[:-1], 4, 4)), tolerance=2e-3)


def pose_of_row(rows: Array, where: Path) -> SE3:
    """Return the poses of x y z qx qy qz qw (..., 7)."""
    norms = np.linalg.norm(rows[..., 3:], axis=-1)
    if np.any(np.abs(norms - 1.0) > NORM_TOLERANCE):
        found = rows[np.abs(norms - 1.0) > NORM_TOLERANCE].reshape(-1, 7)[0, 3:].tolist()
        raise ValueError(f"{where}: expected unit quaternions, found {found}")
    return SE3.from_quaternion(rows[..., 3:], rows[..., :3])


def trajectory(stamps: NDArray[np.int64], poses: SE3, path: Path) -> Trajectory:
    """Return true poses by their stamps in ns; ValueError in one line where there are none or they do not rise."""
    if not len(stamps):
        raise ValueError(f"{path}: expected true poses, found none")
    with told_at(path):
        return Trajectory(stamps, poses)


def require_folder(path: Path) -> Path:
    """Return the folder; ValueError if there is none."""
    if not path.is_dir():
        raise ValueError(f"{path}: expected a folder, found {'a file' if path.exists() else 'none'}")
    return path
