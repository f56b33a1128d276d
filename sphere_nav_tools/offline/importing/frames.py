"""Images of one camera as a folder of files or a video, with stamps where known; which data set a folder looks like."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry.arrays import Bytes
from sphere_nav.geometry.trajectory import associate
from sphere_nav.ros.conversions.stamps import SECOND
from sphere_nav_tools.offline.constants import DEFAULT_HZ, EPOCHS_S
from sphere_nav_tools.offline.importing.files import read_image

FIRST_STAMP_NS = SECOND  # of recordings that start at zero: stamp 0 means 'no stamp'
IMAGES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".pgm", ".ppm"}
VIDEOS = {".mp4", ".avi", ".mkv", ".mov", ".webm", ".m4v"}

SIGNS: dict[str, tuple[tuple[str, ...], ...]] = {
    "seven_scenes": (("frame-*.depth.png",),),
    "tum": (("rgb.txt",), ("img_curr*.png", "img_prev*.png")),
    "openloris": (("color.txt", "aligned_depth.txt"),),
    "rover": (("*D435i",), ("d435i", "t265")),
    "euroc": (("mav0",), ("cam0", "cam1", "imu0")),
    "four_seasons": (("undistorted_images", "times.txt"),),
    "nclt": (("lb3",),),
    "kitti": (("calib.txt", "image_0"), ("calib.txt", "image_2"), ("calib.txt", "image_l")),
    "spherical": (("sphere_*", "Extrinsics"), ("image_*.png", "range_*.png"), ("image_*.jpg", "range_*.png")),
}  # format -> alternatives, of which all names must be there


def is_image(file: Path) -> bool:
    """Whether a file is an image, by its name."""
    return file.suffix.lower() in IMAGES


def guess_format(folder: Path) -> str:
    """Return the format whose files are in the folder; empty: none of SIGNS."""
    for name, alternatives in SIGNS.items():
        if any(all(any(folder.glob(sign)) for sign in signs) for signs in alternatives):
            return name
    return ""


UNITS = {4: 1_000_000, 5: 1_000, 6: 1}  # ns in the unit of a stamp since 1970, by a third of its digits


class Folder:
    """Image files: those of a folder in the order of the last number in their names, or those that are listed.

    Names that are times since 1970 are stamps; a list tells them.
    """

    def __init__(
        self,
        path: Path,
        listed: Sequence[tuple[int | None, Path]] = (),
        read: Callable[[Path], NDArray[Any]] = read_image,
        *,
        is_stamped: bool = False,
    ) -> None:
        """`read`: of a file; `is_stamped`: whether names must be stamps."""
        self.path, self.hz, self._read = path, 0.0, read
        listed = listed or [(stamp_of(f.stem), f) for f in sorted(filter(is_image, path.iterdir()), key=order_of)]
        if not listed:
            raise ValueError(f"{path}: expected images or videos, found none")
        self.files, self.number = [file for _, file in listed], len(listed)
        stamps = [stamp for stamp, _ in listed if stamp is not None]
        self.stamps = stamps if len(stamps) == self.number else None
        if self.stamps is None and is_stamped:
            raise ValueError(f"{path}: expected images named by their stamps, found others")
        if self.stamps is not None and any(np.diff(self.stamps) <= 0):
            raise ValueError(f"{path}: expected names that are rising times, found some that are equal")

    def where(self, index: int) -> object:
        """Return what an image is called in errors."""
        return self.files[index]

    def read(self, index: int) -> NDArray[Any]:
        """Return an image (h, w) grey or (h, w, 3) BGR, or what the reader makes of it."""
        return self._read(self.files[index])


class Video:
    """A video file, read from its beginning to its end."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.stamps: list[int] | None = None
        self._capture = cv2.VideoCapture(str(path))
        self.number = int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT)) if self._capture.isOpened() else 0
        if self.number <= 0:
            raise ValueError(f"{path}: expected a video, found a file that cannot be read as one")
        self.hz = float(np.nan_to_num(self._capture.get(cv2.CAP_PROP_FPS), posinf=0.0))
        self._next = 0

    def where(self, index: int) -> object:
        """Return what an image is called in errors."""
        return f"{self.path}: image {index}"

    def read(self, index: int) -> Bytes:
        """Return an image (h, w, 3) BGR; indices may only rise."""
        while self._next < index and self._capture.grab():
            self._next += 1
        is_read, image = self._capture.read()
        if not is_read or self._next != index:
            raise ValueError(f"{self.path}: expected {self.number} frames, found {self._next}")
        self._next += 1
        return np.asarray(image, dtype=np.uint8)


Frames = Folder | Video  # of one camera


def open_frames(folder: Path, name: str) -> Frames:
    """Return the images of a camera: the folder of that name, a video of that name, or, for '', the folder itself."""
    if folder.is_file() and not name:
        return Video(folder)
    if (folder / name).is_dir() and (name or any(map(is_image, folder.iterdir()))):
        return Folder(folder / name)
    files = sorted(folder.iterdir()) if folder.is_dir() else [folder]
    videos = [file for file in files if file.suffix.lower() in VIDEOS and file.stem == (name or file.stem)]
    if len(videos) != 1:
        found = ", ".join(path.name for path in files[:8]) or "nothing"
        wanted = f"a folder {name} of images or a video {name}.mp4" if name else "images, or one video"
        raise ValueError(f"{folder}: expected {wanted}, found {found}")
    return Video(videos[0])


def instants_of(
    cameras: Mapping[str, Frames], hz: float | None = None, max_gap_ns: int = 0
) -> list[dict[str, tuple[int, int]]]:
    """Return by instant and camera the number of the image and its stamp in ns.

    With stamps, each image belongs to the image of the first camera that is nearest in time; a camera may lack one.
    With `max_gap_ns` each must have one within it, and all have the stamp of the first. Without stamps, images of one
    number are one instant, all cameras have as many, and `hz` or the video's own rate counts.
    """
    first, stamped = next(iter(cameras)), {name: frames.stamps or [] for name, frames in cameras.items()}
    period_ns = 1e9 / (hz or cameras[first].hz or DEFAULT_HZ)
    if not all(stamped.values()):
        number = cameras[first].number
        for name, frames in cameras.items():
            if frames.number != number:
                found = f"found {frames.number} of {name}"
                raise ValueError(f"{frames.path}: expected {number} images as of {first}, {found}")
        stamps = [FIRST_STAMP_NS + round(index * period_ns) for index in range(number)]
        stamped = dict.fromkeys(cameras, stamps)
    reference = np.array(stamped[first], dtype=np.int64)
    near_ns = float(np.median(np.diff(reference))) / 2 if reference.size > 1 else 1e9 / DEFAULT_HZ
    gap_ns = max_gap_ns or math.ceil(near_ns) - 1
    instants: list[dict[str, tuple[int, int]]] = [{} for _ in reference]
    for name, stamps in stamped.items():
        for at, index in zip(*associate(reference, np.array(stamps, np.int64), gap_ns), strict=True):
            instants[at][name] = (int(index), int(reference[at]) if max_gap_ns else stamps[index])
    whole = [instant for instant in instants if not max_gap_ns or len(instant) == len(stamped)]
    if not whole:
        raise ValueError(f"expected {' and '.join(stamped)} within {max_gap_ns} ns, found none")
    return whole


def stamp_of(stem: str) -> int | None:
    """Return the stamp in ns that the name of a file is; None if it is none."""
    if re.fullmatch(r"\d{9,10}\.\d+", stem):
        whole, part = stem.split(".")
        return int(whole) * 1_000_000_000 + int(f"{part:0<9}"[:9]) if float(stem) >= EPOCHS_S else None
    return int(stem) * UNITS.get(len(stem) // 3, 0) or None if stem.isdigit() else None


def order_of(file: Path) -> tuple[Any, ...]:
    """Return by what files are sorted: the time that their name is, or the last number in it."""
    numbers = re.findall(r"\d+", file.stem)
    return (float(file.stem) if stamp_of(file.stem) else int(numbers[-1]) if numbers else -1, file.name)
