"""Raw stereo recordings of several days: EuRoC and TUM-VI (ASL folders), 4Seasons.

Both cameras have their own lens and pose; which is told by `camera_info` and `/tf_static`, not by a baseline.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped

from mcl_depth.geometry.geodetic import AXIS
from sphere_nav.geometry import SE3, Camera, Fisheye, Pinhole
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.files.opencv_file import load_opencv
from sphere_nav.geometry.files.untrusted import number, read_text, required
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.ros.conversions import array_to_image, camera_to_info, se3_to_pose_stamped
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav_tools.offline.constants import MAX_PAIR_GAP_NS
from sphere_nav_tools.offline.importing.recording import (
    MAP_FRAME,
    body_from_optical,
    camera_transforms,
    pose_of_row,
    read_image,
    read_pose,
    require_folder,
)

SIDES = ("left", "right")
TRUTHS = ("state_groundtruth_estimate0", "mocap0", "vicon0")  # of an ASL folder, the best first
MAX_TRUTH_GAP_NS = 500_000_000  # between two true poses with an image between them; 4Seasons gives key frames alone
# 4Seasons was recorded around Munich; its truth is about the Earth's center. One frame for all of it: east, north, up
# at 48.14 deg north, 11.58 deg east, 520 m above the ellipsoid (WGS 84); upright within 0.5 deg 50 km around
MUNICH, MUNICH_M = np.radians([48.14, 11.58]), 520.0
SQUARED_ECCENTRICITY = 0.00669437999014  # of WGS 84


@dataclass(frozen=True)
class Pair:
    """The files of one instant, and the true pose of the left camera where it is known."""

    stamp_ns: int
    images: tuple[Path, Path]
    T_world_left: SE3 | None


class StereoRecording:
    """Pairs of images of a left and a right camera; T_left_right is where the right one is, optical axes."""

    def __init__(self, pairs: list[Pair], cameras: tuple[Camera, Camera], T_left_right: SE3, truth_name: str) -> None:
        self.pairs, self.cameras, self.T_left_right = pairs, cameras, T_left_right
        self.num_frames = len(pairs)
        self.truth_name = truth_name if any(pair.T_world_left is not None for pair in pairs) else ""

    def static_transforms(self, stamp: int) -> list[TransformStamped]:
        """Return base_link -> camera_link -> left_optical, right_optical; the left camera looks along x of both."""
        poses = T_BODY_OPTICAL, T_BODY_OPTICAL @ self.T_left_right
        return camera_transforms(stamp, {f"{side}_optical": T for side, T in zip(SIDES, poses, strict=True)})

    def stamp_ns(self, index: int) -> int:
        """Return the stamp of a pair."""
        return self.pairs[index].stamp_ns

    def frame(self, index: int) -> Iterator[tuple[str, Any]]:
        """Yield both images with their camera_info, and the true pose where it is known."""
        pair = self.pairs[index]
        if pair.T_world_left is not None:
            T_map_body = body_from_optical(pair.T_world_left, is_world_optical=False)
            yield "ground_truth/pose", se3_to_pose_stamped(T_map_body, pair.stamp_ns, MAP_FRAME)
        for side, file, camera in zip(SIDES, pair.images, self.cameras, strict=True):
            image = read_image(file)
            if image.shape[1::-1] != (camera.width, camera.height):
                expected = f"{camera.width} x {camera.height}"
                raise ValueError(f"{file}: expected {expected} pixels, found {image.shape[1]} x {image.shape[0]}")
            yield f"{side}/camera_info", camera_to_info(camera, pair.stamp_ns, f"{side}_optical")
            encoding = "bgr8" if image.ndim == 3 else "mono8"
            yield f"{side}/image_raw", array_to_image(image, pair.stamp_ns, f"{side}_optical", encoding)


def open_euroc(folder: Path) -> StereoRecording:
    """Open an ASL folder: mav0/cam0, cam1 with data.csv and sensor.yaml, and a folder of truth where there is one."""
    require_folder(folder)
    mav = folder / "mav0" if (folder / "mav0").is_dir() else folder
    cameras, poses = zip(*(_asl_camera(mav / name / "sensor.yaml") for name in ("cam0", "cam1")), strict=True)
    left, right = (_asl_images(mav / name) for name in ("cam0", "cam1"))
    stamps = np.array(sorted(right), dtype=np.int64)
    source = next((mav / name / "data.csv" for name in TRUTHS if (mav / name / "data.csv").is_file()), None)
    truth = _asl_truth(source, poses[0]) if source is not None else None
    pairs = []
    for stamp, image in left.items():
        other = int(stamps[np.argmin(np.abs(stamps - stamp))])
        if abs(other - stamp) <= MAX_PAIR_GAP_NS:
            pairs.append(Pair(stamp, (image, right[other]), _pose_at(truth, stamp)))
    if not pairs:
        raise ValueError(f"{mav / 'cam1' / 'data.csv'}: expected stamps of cam0, found others")
    name = "" if source is None else source.parent.name
    return StereoRecording(pairs, (cameras[0], cameras[1]), poses[0].inverse() @ poses[1], name)


def _asl_camera(path: Path) -> tuple[Camera, SE3]:
    """Return the camera of a sensor.yaml and its pose T_body_camera, optical axes."""
    names = ("T_BS", "resolution", "intrinsics", "distortion_model", "distortion_coefficients")
    values = required(load_opencv(path), str(path), names)
    width, height = (round(value) for value in _numbers(values["resolution"], 2, f"{path}: resolution"))
    fx, fy, cx, cy = _numbers(values["intrinsics"], 4, f"{path}: intrinsics")
    k1, k2, k3, k4 = _numbers(values["distortion_coefficients"], 4, f"{path}: distortion_coefficients")
    models: dict[str, type[Pinhole] | type[Fisheye]] = {"radial-tangential": Pinhole, "equidistant": Fisheye}
    if values["distortion_model"] not in models:
        found = repr(values["distortion_model"])[:40]
        raise ValueError(f"{path}: distortion_model: expected {' or '.join(models)}, found {found}")
    matrix = _numbers(required(values["T_BS"], f"{path}: T_BS", ["data"])["data"], 16, f"{path}: T_BS")
    try:
        T_body_camera = SE3.from_matrix(np.reshape(matrix, (4, 4)), tolerance=2e-3)
        model = models[values["distortion_model"]]
        return model(width, height, fx, fy, cx, cy, (k1, k2, k3, k4)), T_body_camera
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _asl_images(folder: Path) -> dict[int, Path]:
    """Return the images of a camera by their stamps, ns."""
    rows = [row.split(",") for row in _rows(folder / "data.csv")]
    if not rows or any(len(row) != 2 or not row[0].strip().isdigit() for row in rows):
        raise ValueError(f"{folder / 'data.csv'}: expected lines 'stamp in ns,file', found others")
    return {int(stamp): folder / "data" / name.strip() for stamp, name in rows}


def _asl_truth(path: Path, T_body_left: SE3) -> Trajectory:
    """Return the true poses of the left camera by those of the body: stamp in ns, x y z, qw qx qy qz, ..."""
    stamps, poses = [], []
    for text in _rows(path):
        words = text.split(",")
        if len(words) < 8 or not words[0].strip().isdigit():
            raise ValueError(f"{path}: expected a stamp in ns and a pose of 7 numbers, found {text[:60]!r}")
        x, y, z, qw, qx, qy, qz = (number(word, str(path)) for word in words[1:8])
        if qw == qx == qy == qz == 0.0:
            continue  # the target was out of sight
        stamps.append(int(words[0]))
        poses.append((pose_of_row(np.array([x, y, z, qx, qy, qz, qw]), path) @ T_body_left).matrix)
    return _trajectory(stamps, poses, path)


def open_four_seasons(folder: Path) -> StereoRecording:
    """Open undistorted_images/cam0, cam1 with times.txt, the set's folder calibration, and GNSSPoses.txt."""
    require_folder(folder)
    calibration = next((p / "calibration" for p in (folder, folder.parent) if (p / "calibration").is_dir()), None)
    if calibration is None:
        raise ValueError(f"{folder.parent / 'calibration'}: expected that of 4Seasons, found none")
    left, right = (require_folder(folder / "undistorted_images" / name) for name in ("cam0", "cam1"))
    cameras = [_undistorted(calibration / f"undistorted_calib_{side}.txt") for side in (0, 1)]
    T_left_right = read_pose(calibration / "undistorted_calib_stereo.txt")
    truth = _gnss_poses(folder) if (folder / "GNSSPoses.txt").is_file() else None
    pairs = []
    for row in _rows(folder / "times.txt"):
        name = row.replace(",", " ").split()[0]
        images = left / f"{name}.png", right / f"{name}.png"
        if not name.isdigit():
            raise ValueError(f"{folder / 'times.txt'}: expected a number as name of an image, found {name[:40]!r}")
        if all(image.is_file() for image in images):
            pairs.append(Pair(int(name), images, _pose_at(truth, int(name))))
    if not pairs:
        raise ValueError(f"{left}: expected images named as in times.txt, found none")
    return StereoRecording(pairs, (cameras[0], cameras[1]), T_left_right, "GNSSPoses.txt")


def _undistorted(path: Path) -> Pinhole:
    """Return the camera of lines 'Pinhole fx fy cx cy 0 0 0 0' and 'width height'."""
    rows = [row.split() for row in _rows(path)]
    if len(rows) < 2 or rows[0][:1] != ["Pinhole"] or len(rows[0]) < 5 or len(rows[1]) != 2:
        raise ValueError(f"{path}: expected 'Pinhole fx fy cx cy ...' and 'width height', found others")
    fx, fy, cx, cy = (number(word, str(path)) for word in rows[0][1:5])
    width, height = (number(word, str(path)) for word in rows[1])
    return Pinhole(int(width), int(height), fx, fy, cx, cy)


def _gnss_poses(folder: Path) -> Trajectory:
    """Return the true poses of the left camera in one frame for the whole set, from its key frames.

    T_e_gpsw inv(T_w_gpsw) T_S_AS takes what is scaled by the last number of a pose to the Earth's frame.
    """
    path = folder / "Transformations.txt"
    named, name = {}, ""
    for line in read_text(path, "transformations of 4Seasons").split("\n"):
        if line.startswith("#"):
            name = line[1:].split(":")[0].strip()
        elif line.strip() and line.count(",") == 6:
            row = np.array([number(word, f"{path}: {name}") for word in line.split(",")])
            named[name] = pose_of_row(row, path)
    needed = required(named, str(path), ("transform_e_gpsw", "transform_w_gpsw", "transform_S_AS"))
    T_map_visual = _T_munich_earth() @ needed["transform_e_gpsw"] @ needed["transform_w_gpsw"].inverse()
    T_map_slam = T_map_visual @ needed["transform_S_AS"]
    stamps, poses = [], []
    for text in _rows(folder / "GNSSPoses.txt"):
        words = text.split(",")
        if len(words) < 9 or not words[0].strip().isdigit():
            raise ValueError(f"{folder / 'GNSSPoses.txt'}: expected 'stamp in ns, pose, scale', found {text[:60]!r}")
        values = np.array([number(word, "GNSSPoses.txt") for word in words[1:9]])
        pose = pose_of_row(values[:7], folder / "GNSSPoses.txt")
        poses.append((T_map_slam @ SE3.from_parts(pose.rotation, values[7] * pose.translation)).matrix)
        stamps.append(int(words[0]))
    return _trajectory(stamps, poses, folder / "GNSSPoses.txt")


def _T_munich_earth() -> SE3:
    """Return what takes coordinates about the Earth's center to east, north and up at MUNICH."""
    latitude, longitude = MUNICH
    east = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    up = np.array([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)])
    radius = AXIS / np.sqrt(1.0 - SQUARED_ECCENTRICITY * np.sin(latitude) ** 2)
    origin = (radius + MUNICH_M) * up - np.array([0.0, 0.0, SQUARED_ECCENTRICITY * radius * np.sin(latitude)])
    return SE3.from_parts(np.stack([east, np.cross(up, east), up], axis=1), origin).inverse()


def _trajectory(stamps: list[int], poses: list[Array], path: Path) -> Trajectory:
    if not stamps:
        raise ValueError(f"{path}: expected poses, found none")
    try:
        return Trajectory(np.array(stamps, dtype=np.int64), SE3(np.stack(poses)))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _pose_at(truth: Trajectory | None, stamp: int) -> SE3 | None:
    if truth is None:
        return None
    found, _ = truth.at([stamp], max_gap_ns=MAX_TRUTH_GAP_NS)
    return found.T_map_body[0] if len(found) else None


def _rows(path: Path) -> list[str]:
    """Return the lines of a file that are no remark."""
    lines = read_text(path, "table").split("\n")
    return [line.strip() for line in lines if line.strip() and not line.lstrip().startswith("#")]


def _numbers(found: Any, count: int, where: str) -> list[float]:
    if not isinstance(found, list) or len(found) != count:
        raise ValueError(f"{where}: expected {count} numbers, found {str(found)[:40]}")
    return [number(value, where) for value in found]
