"""What every data set is read into: images of cameras as files or a video, their instants, the truth; and its messages.

Images have stamps where these are known. `guess_format` tells which data set a folder looks like.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from geometry_msgs.msg import TransformStamped
from numpy.typing import NDArray

from sphere_nav.geometry import SE3, Camera, Rig, Spherical
from sphere_nav.geometry.arrays import Bytes
from sphere_nav.geometry.files.untrusted import parse_stamp_ns
from sphere_nav.geometry.trajectory import Trajectory, associate
from sphere_nav.ros.conversions import (
    array_to_image,
    camera_to_info,
    camera_to_sphere_info,
    se3_to_odometry,
    se3_to_pose_stamped,
    se3_to_transform,
)
from sphere_nav.ros.conversions.headers import SECOND
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav_tools.offline.constants import DEFAULT_HZ, EPOCHS_S
from sphere_nav_tools.offline.importing.files import read_image, require_size

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
MAP_FRAME, BASE_FRAME, CAMERA_FRAME, OPTICAL_FRAME = "map", "base_link", "camera_link", "camera_optical"
RIG_FRAME = "rig_link"
T_OPTICAL_BODY = T_BODY_OPTICAL.inverse()
SIDES = ("left", "right")


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


@dataclass(frozen=True)
class View:
    """A camera: how its topics begin, its frame, its images, its lens and pose.

    `baseline_m` is that of the right camera of a rectified pair.
    """

    prefix: str
    frame_id: str
    camera: Camera
    frames: Pictures
    T_link_camera: SE3 = T_BODY_OPTICAL
    baseline_m: float = 0.0


@dataclass(frozen=True)
class Instant:
    """What was recorded at one time.

    Images by camera; the true pose where it is known; other messages by topic.
    """

    stamp_ns: int
    images: Mapping[str, Picture] = field(default_factory=dict)
    T_map_link: SE3 | None = None
    others: Mapping[str, Callable[[], Any]] = field(default_factory=dict)


@dataclass(frozen=True)
class Recording:
    """A data set: its cameras on a link of the base, its instants, and where its truth comes from.

    The true poses are those of the link, or, `is_truth_of_base`, of base_link on `ground_truth/odometry`.
    `write_beside` writes files that belong into the bag's folder.
    """

    views: Mapping[str, View]
    instants: Sequence[Instant]
    truth: str = ""
    link: str = CAMERA_FRAME
    T_base_link: SE3 = field(default_factory=SE3.identity)
    is_truth_of_base: bool = False
    write_beside: Callable[[Path], None] | None = None

    def static_transforms(self, stamp: int) -> list[TransformStamped]:
        """Return base_link -> the link -> the frames of the cameras."""
        told = {view.frame_id: view.T_link_camera for view in self.views.values() if view.frame_id != self.link}
        frames = [(BASE_FRAME, self.link, self.T_base_link), *((self.link, name, T) for name, T in told.items())]
        return [se3_to_transform(T, stamp, parent, child) for parent, child, T in frames]

    def frame(self, index: int) -> Iterator[tuple[str, Any]]:
        """Yield topic and message of everything that was recorded at one instant: the truth, the lenses, the images."""
        instant = self.instants[index]
        if instant.T_map_link is not None:
            pose, stamp = instant.T_map_link, instant.stamp_ns
            if self.is_truth_of_base:
                found = se3_to_odometry(pose, np.zeros((6, 6)), stamp, (MAP_FRAME, BASE_FRAME))
                yield "ground_truth/odometry", found
            else:
                yield "ground_truth/pose", se3_to_pose_stamped(pose, stamp, MAP_FRAME)
        for topic, make in instant.others.items():
            yield topic, make()
        for name, picture in instant.images.items():
            view = self.views[name]
            if isinstance(view.camera, Spherical):
                yield f"{view.prefix}sphere_info", camera_to_sphere_info(view.camera, view.frame_id)
            else:
                info = camera_to_info(view.camera, picture.stamp_ns, view.frame_id, baseline=view.baseline_m)
                yield f"{view.prefix}camera_info", info
        for name, picture in instant.images.items():
            view, pixels = self.views[name], picture.read()
            require_size(picture.where, pixels, view.camera)
            encoding = "32FC1" if pixels.dtype == np.float32 else "bgr8" if pixels.ndim == 3 else "mono8"
            yield f"{view.prefix}image_raw", array_to_image(pixels, picture.stamp_ns, view.frame_id, encoding)


def camera_recording(views: Mapping[str, View], link: str = CAMERA_FRAME, max_gap_ns: int = 0) -> Recording:
    """Return the images of cameras, as of `instants_of`; the first of an instant is that of the instant."""
    found = instants_of({name: view.frames for name, view in views.items()}, max_gap_ns)
    instants = [Instant(min(one.stamp_ns for one in images.values()), images) for images in found]
    return Recording(views, instants, link=link)


def rig_views(rig: Rig, frames: Mapping[str, Pictures], prefix: str = "cameras/{}/") -> dict[str, View]:
    """Return the cameras of a rig with their images; prefix: how their topics begin, with {} for the name."""
    optical = [(part, frames[part.name], f"{part.name}_optical") for part in rig.cameras]
    return {
        part.name: View(prefix.format(part.name), frame, part.camera, images, part.T_rig_camera)
        for part, images, frame in optical
    }


def pair_views(
    frames: Sequence[Pictures], lenses: Sequence[Camera], T_left_right: SE3, baseline_m: float = 0.0
) -> dict[str, View]:
    """Return a stereo pair whose left camera looks along x of its link; T_left_right between optical axes."""
    poses, baselines = (T_BODY_OPTICAL, T_BODY_OPTICAL @ T_left_right), (0.0, baseline_m)
    return {
        side: View(f"{side}/", f"{side}_optical", lens, images, pose, baseline)
        for side, lens, images, pose, baseline in zip(SIDES, lenses, frames, poses, baselines, strict=True)
    }


def with_truth(
    recording: Recording,
    source: str,
    truth: Trajectory | None,
    max_gap_ns: int = 0,
    T_pose_link: SE3 = T_OPTICAL_BODY,
) -> Recording:
    """Return the recording with the true poses of its instants; `source`: where they come from.

    One between two rows counts where these are at most `max_gap_ns` apart. T_pose_link takes poses to those of the
    link; as it is, from those of an optical frame in a world with z up.
    """
    if truth is None:
        return recording
    found, known = truth.at([instant.stamp_ns for instant in recording.instants], max_gap_ns)
    poses, instants = iter((found.T_map_body @ T_pose_link).matrix), list[Instant]()
    for instant, is_known in zip(recording.instants, known, strict=True):
        instants.append(replace(instant, T_map_link=SE3(next(poses)) if is_known else None))
    return replace(recording, instants=instants, truth=source if known.any() else "")
