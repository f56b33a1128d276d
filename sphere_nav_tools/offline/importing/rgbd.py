"""RGB-D recordings: Microsoft 7-Scenes, TUM, and of many days OpenLORIS and ROVER."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from numpy.typing import NDArray

from sphere_mapping.acquisition.partial.depth_registration import DepthRegistration
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.files.opencv_file import load_opencv
from sphere_nav.geometry.files.untrusted import number as number_of
from sphere_nav.geometry.files.untrusted import parse_stamp_ns, read_text, required
from sphere_nav.geometry.trajectory import Trajectory, read_tum
from sphere_nav.ros.conversions import array_to_image, camera_to_info, se3_to_pose_stamped
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav_tools.offline.constants import MAX_PAIR_GAP_NS
from sphere_nav_tools.offline.importing.recording import (
    FIRST_STAMP_NS,
    MAP_FRAME,
    OPTICAL_FRAME,
    body_from_optical,
    camera_transforms,
    pose_of_row,
    read_depth_file,
    read_image,
    read_numbers,
    read_pose,
    require_folder,
)

KINECT_HZ = 30.0
D435 = "d400_color_optical_frame"  # of OpenLORIS: its colour camera, to which aligned_depth is registered
ROVER_FOLDERS = ("intelrealsense_D435i", "realsense_D435i", "d435i")
FAR = np.iinfo(np.uint16).max  # invalid in 7-Scenes


@dataclass(frozen=True)
class Frame:
    """The files of one instant; T_world_optical is the pose of the camera that made the image."""

    stamp_ns: int
    image: Path
    depth: Path
    T_world_optical: SE3 | None


@dataclass(frozen=True)
class DepthCamera:
    """The depth camera of a Kinect: its own lens, and where the colour camera sees its points."""

    camera: Pinhole
    T_color_depth: SE3


class RgbdRecording:
    """Frames of colour and depth; `depth_camera` is None where the depth is registered to the colour."""

    def __init__(
        self,
        frames: list[Frame],
        camera: Pinhole,
        depth_units: float,
        depth_camera: DepthCamera | None = None,
        *,
        is_world_optical: bool = False,
        truth_name: str = "",
        T_base_camera: SE3 | None = None,
    ) -> None:
        self.frames, self.camera, self.depth_units, self.depth_camera = frames, camera, depth_units, depth_camera
        self.is_world_optical, self.truth_name = is_world_optical, truth_name
        self.num_frames, self.T_base_camera = len(frames), T_base_camera

    def static_transforms(self, stamp: int) -> list[TransformStamped]:
        """Return base_link -> camera_link -> camera_optical."""
        return camera_transforms(stamp, {OPTICAL_FRAME: T_BODY_OPTICAL}, self.T_base_camera)

    def stamp_ns(self, index: int) -> int:
        """Return the stamp of a frame."""
        return self.frames[index].stamp_ns

    def frame(self, index: int) -> Iterator[tuple[str, Any]]:
        """Yield camera_info, image and registered depth, and the true pose where it is known."""
        frame = self.frames[index]
        stamp = frame.stamp_ns
        image = read_image(frame.image)
        self._check_size(frame.image, image)
        if frame.T_world_optical is not None:
            T_map_body = body_from_optical(frame.T_world_optical, is_world_optical=self.is_world_optical)
            yield "ground_truth/pose", se3_to_pose_stamped(T_map_body, stamp, MAP_FRAME)
        yield "camera_info", camera_to_info(self.camera, stamp, OPTICAL_FRAME)
        yield "depth/camera_info", camera_to_info(self.camera, stamp, OPTICAL_FRAME)
        yield "depth/image_raw", array_to_image(self._depth(frame.depth), stamp, OPTICAL_FRAME, "32FC1")
        yield "image_raw", array_to_image(image, stamp, OPTICAL_FRAME, "bgr8" if image.ndim == 3 else "mono8")

    def _depth(self, path: Path) -> NDArray[np.float32]:
        units = read_depth_file(path)
        self._check_size(path, units)  # of Kinects both have the same
        depth = units.astype(np.float32) / np.float32(self.depth_units)
        depth[(units == 0) | (units == FAR)] = np.nan
        if self.depth_camera is None:
            return depth
        return self._registration(depth)

    @cached_property
    def _registration(self) -> DepthRegistration:
        assert self.depth_camera is not None
        return DepthRegistration(self.depth_camera.camera, self.camera, self.depth_camera.T_color_depth)

    def _check_size(self, path: Path, pixels: NDArray[Any]) -> None:
        expected, found = (self.camera.width, self.camera.height), pixels.shape[1::-1]
        if found != expected:
            raise ValueError(f"{path}: expected {expected[0]} x {expected[1]} pixels, found {found[0]} x {found[1]}")


def open_seven_scenes(
    folder: Path,
    camera: Pinhole,
    depth_camera: DepthCamera | None,
    *,
    is_truth_of_depth: bool,
    poses: Path | None = None,
) -> RgbdRecording:
    """Open frame-%06d.{color.png|jpg, depth.png, pose.txt}; depth in mm, 0 and 65535 invalid; poses camera -> world.

    `poses` is a folder with other pose.txt than those beside the images.
    """
    depths = sorted(require_folder(folder).glob("frame-*.depth.png"))
    if not depths:
        raise ValueError(f"{folder}: expected files frame-000000.depth.png and on, found none")
    T_depth_color = SE3.identity()
    if depth_camera is not None and is_truth_of_depth:
        T_depth_color = depth_camera.T_color_depth.inverse()
    frames = []
    for depth in depths:
        name = depth.name.removesuffix(".depth.png")
        color = next(
            (depth.with_name(name + end) for end in (".color.png", ".color.jpg") if _is(depth, name + end)), None
        )
        if color is None:
            raise ValueError(f"{folder / name}.color.png: expected a file (or .color.jpg), found none")
        stamp = FIRST_STAMP_NS + round(_number(depth, name) * 1e9 / KINECT_HZ)
        T_world_camera = read_pose((poses or folder) / f"{name}.pose.txt")
        frames.append(Frame(stamp, color, depth, T_world_camera @ T_depth_color))
    return RgbdRecording(frames, camera, 1000.0, depth_camera, is_world_optical=True, truth_name="frame-*.pose.txt")


def open_tum(folder: Path, camera: Pinhole, depth_units: float) -> RgbdRecording:
    """Open rgb.txt, depth.txt and groundtruth.txt of the TUM benchmark, or a pair img_prev, dep_prev, pose_prev, ..."""
    require_folder(folder)
    is_pair = (folder / "img_prev.png").is_file()
    if not is_pair and not (folder / "rgb.txt").is_file():
        inner = sorted(path.parent.name for path in folder.glob("*/img_prev.png"))
        hint = f": name one of its folders {', '.join(inner)}" if inner else ""
        raise ValueError(f"{folder / 'rgb.txt'}: expected a file, found none{hint}")
    frames = _tum_pair(folder) if is_pair else _tum_sequence(folder)
    truth = "pose_prev.txt, pose_curr.txt" if is_pair else "groundtruth.txt"
    has_truth = any(frame.T_world_optical is not None for frame in frames)
    return RgbdRecording(frames, camera, depth_units, truth_name=truth if has_truth else "")


def _tum_pair(folder: Path) -> list[Frame]:
    frames = []
    for number, name in enumerate(("prev", "curr")):
        file = folder / f"pose_{name}.txt"
        rows = read_numbers(file, 7)
        if len(rows) != 1:
            raise ValueError(f"{file}: expected one pose, found {len(rows)}")
        stamp = FIRST_STAMP_NS + round(number * 1e9 / KINECT_HZ)
        T_world_optical = pose_of_row(rows[0], file)
        frames.append(Frame(stamp, folder / f"img_{name}.png", folder / f"dep_{name}.png", T_world_optical))
    return frames


def _tum_sequence(folder: Path) -> list[Frame]:
    images, depths = _read_list(folder / "rgb.txt"), _read_list(folder / "depth.txt")
    truth = read_tum(folder / "groundtruth.txt") if (folder / "groundtruth.txt").exists() else None
    return _pair_up(folder, images, depths, truth)


def open_openloris(folder: Path) -> RgbdRecording:
    """Open color.txt, aligned_depth.txt (mm), sensors.yaml, trans_matrix.yaml and groundtruth.txt, of the base."""
    images, depths = (_read_list(require_folder(folder) / name) for name in ("color.txt", "aligned_depth.txt"))
    sensors, path = load_opencv(folder / "sensors.yaml"), folder / "sensors.yaml"
    fields = ("width", "height", "intrinsics")
    values = required(required(sensors, str(path), [D435])[D435], f"{path}: {D435}", fields)
    lens = [number_of(value, f"{path}: intrinsics") for value in _data(values["intrinsics"], path)]
    distortion = [number_of(v, f"{path}: distortion") for v in _data(values.get("distortion_coefficients"), path)]
    if len(lens) != 4:
        raise ValueError(f"{path}: intrinsics: expected fx cx fy cy, found {len(lens)} numbers")
    fx, cx, fy, cy = lens
    size = [int(number_of(values[name], f"{path}: {name}")) for name in ("width", "height")]
    camera = Pinhole(size[0], size[1], fx, fy, cx, cy, tuple(distortion))
    T_base_optical = _mounting(folder / "trans_matrix.yaml")
    truth = None
    if (folder / "groundtruth.txt").is_file():
        base = read_tum(folder / "groundtruth.txt")
        truth = Trajectory(base.stamps_ns, base.T_map_body @ T_base_optical)
    frames = _pair_up(folder, images, depths, truth)
    T_base_camera = T_base_optical @ T_BODY_OPTICAL.inverse()
    name = "groundtruth.txt" if any(frame.T_world_optical is not None for frame in frames) else ""
    return RgbdRecording(frames, camera, 1000.0, truth_name=name, T_base_camera=T_base_camera)


def open_rover(folder: Path, camera: Pinhole) -> RgbdRecording:
    """Open rgb and depth (mm, registered) of the D435i of ROVER, images named by their stamps in s.

    Its truth is the place of a prism on the vehicle, no pose of a camera: it is left out.
    """
    require_folder(folder)
    inner = next((folder / name for name in ROVER_FOLDERS if (folder / name / "rgb").is_dir()), folder)
    images, depths = (_stamped(require_folder(inner / name)) for name in ("rgb", "depth"))
    return RgbdRecording(_pair_up(inner, images, depths, None), camera, 1000.0)


def _mounting(path: Path) -> SE3:
    """Return T_base_optical of the colour camera from a list of parent_frame, child_frame and matrix."""
    found = required(load_opencv(path), str(path), ["trans_matrix"])["trans_matrix"]
    rows = [required(row, f"{path}: trans_matrix", ("parent_frame", "child_frame", "matrix")) for row in found or ()]
    frame, T_frame_optical = D435, SE3.identity()
    for _ in rows:
        if frame == "base_link":
            break
        row = next((row for row in rows if row["child_frame"] == frame), None)
        values = [number_of(value, f"{path}: matrix") for value in _data(row and row["matrix"], path)]
        if row is None or len(values) != 16:
            raise ValueError(f"{path}: expected a matrix of 4 x 4 from {frame} towards base_link, found none")
        T_frame_optical = SE3.from_matrix(np.reshape(values, (4, 4)), tolerance=2e-3) @ T_frame_optical
        frame = str(row["parent_frame"])
    if frame != "base_link":
        raise ValueError(f"{path}: expected a way from {D435} to base_link, found none")
    return T_frame_optical


def _data(found: Any, path: Path) -> list[Any]:
    """Return the numbers of an OpenCV matrix, none where there is none."""
    if found is None:
        return []
    data = required(found, str(path), ["data"])["data"]
    if not isinstance(data, list):
        raise ValueError(f"{path}: data: expected a list of numbers, found {str(data)[:40]}")
    return data


def _stamped(folder: Path) -> list[tuple[int, str]]:
    """Return the stamps, ns, and names below the parent of image files named by their stamps in s."""
    names = sorted(folder.glob("*.png"), key=lambda path: parse_stamp_ns(path.stem, f"{path}: name"))
    if not names:
        raise ValueError(f"{folder}: expected images, found none")
    return [(parse_stamp_ns(path.stem, f"{path}: name"), f"{folder.name}/{path.name}") for path in names]


def _pair_up(
    folder: Path, images: list[tuple[int, str]], depths: list[tuple[int, str]], truth: Trajectory | None
) -> list[Frame]:
    """Return each image with the depth that is nearest in time, where that is near."""
    depth_stamps = np.array([stamp for stamp, _ in depths], dtype=np.int64)
    frames = []
    for stamp, image in images:
        nearest = int(np.argmin(np.abs(depth_stamps - stamp)))
        if abs(int(depth_stamps[nearest]) - stamp) <= MAX_PAIR_GAP_NS:
            pose = None if truth is None else _pose_at(truth, stamp)
            frames.append(Frame(stamp, folder / image, folder / depths[nearest][1], pose))
    if not frames:
        raise ValueError(f"{folder}: expected depth within {MAX_PAIR_GAP_NS} ns of an image, found none")
    return frames


def _pose_at(truth: Trajectory, stamp: int) -> SE3 | None:
    """Return the pose between the two rows around the stamp, None where they are too far away."""
    found, _ = truth.at([stamp], max_gap_ns=2 * MAX_PAIR_GAP_NS)
    return found.T_map_body[0] if len(found) else None


def _read_list(path: Path) -> list[tuple[int, str]]:
    lines = read_text(path, "list of images").split("\n")
    rows = [line.split() for line in lines if line.strip() and not line.startswith("#")]
    if not rows or any(len(row) != 2 for row in rows):
        raise ValueError(f"{path}: expected lines 'stamp file', found {len(rows)} lines")
    return [(parse_stamp_ns(stamp, f"{path}: stamp"), name) for stamp, name in rows]


def _is(beside: Path, name: str) -> bool:
    return beside.with_name(name).is_file()


def _number(path: Path, name: str) -> int:
    digits = name.removeprefix("frame-")
    if not digits.isdigit():
        raise ValueError(f"{path}: expected frame-<number>, found {name}")
    return int(digits)
