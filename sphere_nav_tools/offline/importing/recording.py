"""What every data set is read into, and the files that most of them are made of."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from io import StringIO
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
from geometry_msgs.msg import TransformStamped
from numpy.typing import NDArray

from sphere_nav.geometry import SE3, Camera, Spherical
from sphere_nav.geometry.arrays import Array, Bytes, Floats
from sphere_nav.geometry.files.encoded import read_image_file
from sphere_nav.geometry.files.untrusted import (
    MAX_NUMBER,
    MAX_TABLE_BYTES,
    number,
    numbers,
    printable,
    read_text,
    required,
    short,
    told_at,
)
from sphere_nav.geometry.trajectory import NORM_TOLERANCE, Trajectory
from sphere_nav.ros.conversions import (
    array_to_image,
    camera_to_info,
    camera_to_sphere_info,
    se3_to_odometry,
    se3_to_pose_stamped,
    se3_to_transform,
)
from sphere_nav.ros.conversions.stamps import SECOND
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav_tools.offline.pose_bags import trajectory_of

FIRST_STAMP_NS = SECOND  # of recordings that start at zero: stamp 0 means 'no stamp'
MAP_FRAME, BASE_FRAME, CAMERA_FRAME, OPTICAL_FRAME = "map", "base_link", "camera_link", "camera_optical"
SIDES = ("left", "right")


class ImageSource(Protocol):
    """The images of one camera, by their number."""

    def where(self, index: int) -> Path | str:
        """Return what an image is called in errors."""
        ...

    def read(self, index: int) -> NDArray[Any]:
        """Return an image (h, w) grey or (h, w, 3) BGR, or a depth image."""
        ...


@dataclass(frozen=True)
class View:
    """A camera: how its topics begin, its frame, its lens and pose, which the bag tells, or else a rig file.

    `baseline_m` is that of the right camera of a rectified pair.
    """

    prefix: str
    frame_id: str
    camera: Camera
    T_link_camera: SE3 = T_BODY_OPTICAL
    baseline_m: float = 0.0
    is_told: bool = True


@dataclass(frozen=True)
class Instant:
    """What was recorded at one time.

    By camera the number of its image and that one's own stamp in ns; the true pose where it is known; other messages by
    topic.
    """

    stamp_ns: int
    images: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    T_map_link: SE3 | None = None
    others: Mapping[str, Callable[[], Any]] = field(default_factory=dict)


@dataclass(frozen=True)
class Recording:
    """A data set: its cameras on a link of the base, its instants, and where its truth comes from.

    The true poses are those of the link, or, `is_truth_of_base`, of base_link on `ground_truth/odometry`.
    `write_beside` writes files that belong into the bag's folder.
    """

    cameras: Mapping[str, ImageSource]
    views: Mapping[str, View]
    instants: Sequence[Instant]
    truth: str = ""
    link: str = CAMERA_FRAME
    T_base_link: SE3 = field(default_factory=SE3.identity)
    is_truth_of_base: bool = False
    write_beside: Callable[[Path], None] | None = None

    @property
    def truth_name(self) -> str:
        """Where the truth comes from; empty where there is none."""
        return self.truth if any(instant.T_map_link is not None for instant in self.instants) else ""

    def static_transforms(self, stamp: int) -> list[TransformStamped]:
        """Return base_link -> the link -> the frames of the cameras whose poses are told."""
        told = {view.frame_id: view.T_link_camera for view in self.views.values() if view.is_told}
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
        for name, (_, stamp) in instant.images.items():
            view = self.views[name]
            if isinstance(view.camera, Spherical):
                yield f"{view.prefix}sphere_info", camera_to_sphere_info(view.camera, view.frame_id)
            elif view.is_told:
                info = camera_to_info(view.camera, stamp, view.frame_id, baseline=view.baseline_m)
                yield f"{view.prefix}camera_info", info
        for name, (at, stamp) in instant.images.items():
            view, frames = self.views[name], self.cameras[name]
            pixels = frames.read(at)
            require_size(frames.where(at), pixels, view.camera)
            encoding = "32FC1" if pixels.dtype == np.float32 else "bgr8" if pixels.ndim == 3 else "mono8"
            yield f"{view.prefix}image_raw", array_to_image(pixels, stamp, view.frame_id, encoding)


def pair_views(left: Camera, right: Camera, T_left_right: SE3, baseline_m: float = 0.0) -> dict[str, View]:
    """Return a stereo pair whose left camera looks along x of its link; T_left_right between optical axes."""
    poses, baselines = (T_BODY_OPTICAL, T_BODY_OPTICAL @ T_left_right), (0.0, baseline_m)
    return {
        side: View(f"{side}/", f"{side}_optical", camera, pose, baseline)
        for side, camera, pose, baseline in zip(SIDES, (left, right), poses, baselines, strict=True)
    }


def with_truth(recording: Recording, truth: str, poses: Sequence[SE3 | None]) -> Recording:
    """Return the recording with the true poses of its instants; `truth`: where they come from."""
    pairs = zip(recording.instants, poses, strict=True)
    return replace(recording, instants=[replace(one, T_map_link=pose) for one, pose in pairs], truth=truth)


def bodies_at(truth: Trajectory | None, recording: Recording, max_gap_ns: int) -> list[SE3 | None]:
    """Return where the body of a camera was, by the poses of its optical frame in a world with z up."""
    found = poses_at(truth, recording, max_gap_ns)
    return [None if pose is None else pose @ T_BODY_OPTICAL.inverse() for pose in found]


def poses_at(truth: Trajectory | None, recording: Recording, max_gap_ns: int) -> list[SE3 | None]:
    """Return the poses between the rows around each instant; None where there is no truth, or none so near."""
    stamps = [instant.stamp_ns for instant in recording.instants]
    if truth is None:
        return [None] * len(stamps)
    found, known = truth.at(stamps, max_gap_ns=max_gap_ns)
    poses = iter(found.T_map_body.matrix)
    return [SE3(next(poses)) if is_known else None for is_known in known]


def ahead_up(T_world_optical: SE3) -> SE3:
    """Return where the body of a camera is, in a map with body axes, by its pose in a world with optical axes."""
    return T_BODY_OPTICAL @ T_world_optical @ T_BODY_OPTICAL.inverse()


def require_size(where: Path | str, pixels: NDArray[Any], camera: Camera) -> None:
    """Raise ValueError where an image is not of the size of its camera."""
    if pixels.shape[1::-1] != (camera.width, camera.height):
        found = f"found {pixels.shape[1]} x {pixels.shape[0]}"
        raise ValueError(f"{where}: expected {camera.width} x {camera.height} pixels, {found}")


def read_image(path: Path) -> NDArray[Any]:
    """Return an 8-bit image (H, W) grey or (H, W, 3) BGR."""
    return _decode(path, cv2.IMREAD_ANYCOLOR, np.uint8)


def read_rgb(path: Path) -> Bytes:
    """Return a grey (H, W) or RGB (H, W, 3) image."""
    image = read_image(path)
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB).astype(np.uint8) if image.ndim == 3 else image


def read_meters(path: Path, units_per_m: float, far: float = np.nan) -> Floats:
    """Return depth or range (H, W) of a 16-bit image in m; 0 is unknown, 65535 `far`."""
    units = read_depth_file(path)
    meters = units.astype(np.float32) / np.float32(units_per_m)
    meters[units == 0], meters[units == np.iinfo(np.uint16).max] = np.nan, far
    return meters


def read_depth_file(path: Path) -> NDArray[np.uint16]:
    """Return a 16-bit image (H, W)."""
    pixels = _decode(path, cv2.IMREAD_UNCHANGED, np.uint16)
    if pixels.ndim != 2:
        raise ValueError(f"{path}: expected one channel, found {pixels.shape[2]}")
    return pixels


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


def read_stamped(path: Path, count: int) -> Iterator[tuple[int, list[float]]]:
    """Yield the stamp in ns and so many numbers behind it of each line."""
    for where, words in read_words(path, count + 1):
        yield whole(words[0], where), [number(word, where) for word in words[1 : count + 1]]


def whole(word: str, where: str) -> int:
    """Return a whole number."""
    if not word.isdecimal():
        raise ValueError(f"{where}: expected a whole number, found {short(word)}")
    return int(word)


def read_pose(path: Path) -> SE3:
    """Return a pose from a file with a 4 x 4 matrix."""
    return pose_of_matrix(read_numbers(path, 4, 4), path)


def pose_of_matrix(values: Any, where: Path) -> SE3:
    """Return the pose of 16 numbers, row by row."""
    with told_at(where):
        return SE3.from_matrix(np.reshape(values, (4, 4)), tolerance=2e-3)


def pose_of_row(row: Array, where: Path) -> SE3:
    """Return the pose of x y z qx qy qz qw (7,)."""
    if abs(np.linalg.norm(row[3:]) - 1.0) > NORM_TOLERANCE:
        raise ValueError(f"{where}: expected unit quaternions, found {row[3:].tolist()}")
    return SE3.from_quaternion(row[3:], row[:3])


def trajectory(stamps: Any, poses: SE3 | Sequence[SE3], path: Path) -> Trajectory:
    """Return true poses by their stamps in ns; ValueError in one line where there are none or they do not rise."""
    if not len(stamps):
        raise ValueError(f"{path}: expected true poses, found none")
    with told_at(path):
        return Trajectory(stamps, poses) if isinstance(poses, SE3) else trajectory_of(stamps, poses)


def matrix_data(found: Any, where: str, count: int | None = None) -> tuple[float, ...]:
    """Return the numbers of an OpenCV matrix."""
    return numbers(required(found, where, ["data"])["data"], where, count)


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
