"""Images of one camera as a folder of files or a video, with stamps where known; which data set a folder looks like."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry.arrays import Bytes
from sphere_nav.geometry.files.untrusted import parse_stamp_ns
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


class Picture(NamedTuple):
    """An image: its stamp in ns, what it is called in errors, and what reads it: (h, w) grey, (h, w, 3) BGR, ..."""

    stamp_ns: int
    where: object
    read: Callable[[], NDArray[Any]]


Pictures = Sequence[Picture]  # of one camera, in the order of time


def listed(files: Iterable[tuple[int, Path]], read: Callable[[Path], NDArray[Any]] = read_image) -> Pictures:
    """Return the images of files with their stamps."""
    return [Picture(stamp, file, partial(read, file)) for stamp, file in files]


def of_folder(
    path: Path, read: Callable[[Path], NDArray[Any]] = read_image, hz: float | None = None, *, is_stamped: bool = False
) -> Pictures:
    """Return the images of a folder in the order of the last number in their names.

    Names that are times since 1970 are stamps, if all are; else `hz` counts, unless they must be: `is_stamped`.
    """
    files = sorted(filter(is_image, path.iterdir()), key=order_of)
    if not files:
        raise ValueError(f"{path}: expected images or videos, found none")
    named = [stamp for file in files if (stamp := stamp_of(file.stem)) is not None]
    if is_stamped and len(named) < len(files):
        raise ValueError(f"{path}: expected images named by their stamps, found others")
    stamps = named if len(named) == len(files) else even_stamps(len(files), hz or DEFAULT_HZ)
    if any(np.diff(stamps) <= 0):
        raise ValueError(f"{path}: expected names that are rising times, found some that are equal")
    return listed(zip(stamps, files, strict=True), read)


def of_video(path: Path, hz: float | None = None) -> Pictures:
    """Return the images of a video, by its own rate where no other is given."""
    video = Video(path)
    stamps = even_stamps(video.number, hz or video.hz or DEFAULT_HZ)
    return [Picture(at, f"{path}: image {index}", partial(video.read, index)) for index, at in enumerate(stamps)]


def even_stamps(number: int, hz: float) -> list[int]:
    """Return the stamps of images that have none."""
    return [FIRST_STAMP_NS + round(index * 1e9 / hz) for index in range(number)]


class Video:
    """A video file, which is read from its beginning to its end, and from its beginning again."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._open()
        self.number = int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT)) if self._capture.isOpened() else 0
        if self.number <= 0:
            raise ValueError(f"{path}: expected a video, found a file that cannot be read as one")
        self.hz = float(np.nan_to_num(self._capture.get(cv2.CAP_PROP_FPS), posinf=0.0))

    def _open(self) -> None:
        self._capture, self._next = cv2.VideoCapture(str(self.path)), 0

    def read(self, index: int) -> Bytes:
        """Return an image (h, w, 3) BGR."""
        if index < self._next:
            self._open()
        while self._next < index and self._capture.grab():
            self._next += 1
        is_read, image = self._capture.read()
        if not is_read or self._next != index:
            raise ValueError(f"{self.path}: expected {self.number} frames, found {self._next}")
        self._next += 1
        return np.asarray(image, dtype=np.uint8)


def open_frames(folder: Path, name: str, hz: float | None = None) -> Pictures:
    """Return the images of a camera: the folder of that name, a video of that name, or, for '', the folder itself."""
    if folder.is_file() and not name:
        return of_video(folder, hz)
    if (folder / name).is_dir() and (name or any(map(is_image, folder.iterdir()))):
        return of_folder(folder / name, hz=hz)
    files = sorted(folder.iterdir()) if folder.is_dir() else [folder]
    videos = [file for file in files if file.suffix.lower() in VIDEOS and file.stem == (name or file.stem)]
    if len(videos) != 1:
        found = ", ".join(path.name for path in files[:8]) or "nothing"
        wanted = f"a folder {name} of images or a video {name}.mp4" if name else "images, or one video"
        raise ValueError(f"{folder}: expected {wanted}, found {found}")
    return of_video(videos[0], hz)


def instants_of(cameras: Mapping[str, Pictures], max_gap_ns: int = 0) -> list[dict[str, Picture]]:
    """Return the image of each camera by instant: that nearest in time to one of the first; a camera may lack one.

    With `max_gap_ns` each must have one within it, and all have the stamp of the first. Without stamps in their names
    all cameras have as many.
    """
    first = next(iter(cameras))
    reference = np.array([one.stamp_ns for one in cameras[first]], np.int64)
    near_ns = float(np.median(np.diff(reference))) / 2 if reference.size > 1 else 1e9 / DEFAULT_HZ
    gap_ns = max_gap_ns or math.ceil(near_ns) - 1
    instants: list[dict[str, Picture]] = [{} for _ in reference]
    for name, pictures in cameras.items():
        if pictures[0].stamp_ns == FIRST_STAMP_NS and len(pictures) != len(reference):
            found = f"found {len(pictures)} of {name}"
            raise ValueError(f"{pictures[0].where}: expected {len(reference)} images as of {first}, {found}")
        stamps = np.array([one.stamp_ns for one in pictures], np.int64)
        for at, index in zip(*associate(reference, stamps, gap_ns), strict=True):
            one = pictures[index]
            instants[at][name] = one._replace(stamp_ns=int(reference[at])) if max_gap_ns else one
    whole = [instant for instant in instants if not max_gap_ns or len(instant) == len(cameras)]
    if not whole:
        raise ValueError(f"expected {' and '.join(cameras)} within {max_gap_ns} ns, found none")
    return whole


def stamp_of(stem: str) -> int | None:
    """Return the stamp in ns that the name of a file is; None if it is none."""
    if re.fullmatch(r"\d{9,10}\.\d+", stem):
        return parse_stamp_ns(stem, "name") if float(stem) >= EPOCHS_S else None
    return int(stem) * UNITS.get(len(stem) // 3, 0) or None if stem.isdigit() else None


def order_of(file: Path) -> tuple[Any, ...]:
    """Return by what files are sorted: the time that their name is, or the last number in it."""
    numbers = re.findall(r"\d+", file.stem)
    return (float(file.stem) if stamp_of(file.stem) else int(numbers[-1]) if numbers else -1, file.name)
