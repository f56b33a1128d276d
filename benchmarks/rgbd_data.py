"""Recorded RGB-D images with true poses: folders of 7-Scenes layout and folders of single pairs (TUM)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import SE3, Pinhole

KINECT = (640, 480)
INVALID_MM = (0, 65535)  # 7-Scenes writes both where the sensor saw nothing
COLMAP_POSES = "_colmap_poses"  # folder beside a recording that has its name and this: poses of its colour camera


@dataclass(frozen=True, eq=False)
class Frame:
    """One grey image with its depth along z in the same pixels, and the true pose of this camera."""

    name: str
    gray: NDArray[np.uint8]  # (H, W)
    depth_m: NDArray[np.float32]  # (H, W), NaN where not measured
    T_world_camera: SE3


@dataclass(frozen=True)
class Calibration:
    """Intrinsics of the colour image; `depth_camera` where depth must be carried into it first."""

    name: str
    camera: Pinhole
    depth_camera: Pinhole | None = None
    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  # X_colour = X_depth + offset

    @property
    def T_color_depth(self) -> SE3:
        """Pose of the depth camera in the colour camera."""
        return SE3.from_parts(np.eye(3), self.offset_m)


DEPTH_585 = Pinhole(*KINECT, 585.0, 585.0, 320.0, 240.0)
SEVEN_SCENES = (
    Calibration("585", DEPTH_585),
    Calibration("525", Pinhole(*KINECT, 525.0, 525.0, 320.0, 240.0), DEPTH_585, (-0.025, 0.0, 0.0)),
)
TUM_FR1 = (
    Calibration("517", Pinhole(*KINECT, 517.3, 516.5, 318.6, 255.3)),
    Calibration("525", Pinhole(*KINECT, 525.0, 525.0, 319.5, 239.5)),
)


@dataclass(frozen=True)
class Recording:
    """Pairs of frames by how far they are apart; images are read when asked for."""

    folder: Path
    calibrations: tuple[Calibration, ...]
    pairs: Callable[[int, int], list[tuple[Path, Path]]]  # (frames apart, frames between starts)
    read: Callable[[Path], Frame]
    gaps: tuple[int, ...] = ()  # the only gaps it can give; empty: any
    is_truth_of_depth: bool = False  # the true poses are those of the depth camera, where it is another

    def frame(self, path: Path, calibration: Calibration) -> Frame:
        """Return one frame as `calibration` sees it."""
        found = self.read(path)
        if calibration.depth_camera is None:
            return found
        T_depth_color = calibration.T_color_depth.inverse() if self.is_truth_of_depth else SE3.identity()
        return replace(registered(found, calibration), T_world_camera=found.T_world_camera @ T_depth_color)


def open_recording(folder: Path, poses: Path | None = None) -> Recording:
    """Find out which layout a folder has; ValueError says what was expected.

    `poses`: frame-*.pose.txt of the colour camera of a 7-Scenes recording, in place of the recorded ones, which are of
    its depth camera. They hold by the colour camera's own lens alone.
    """
    if any(folder.glob("frame-*.pose.txt")):
        chosen = SEVEN_SCENES if poses is None else [one for one in SEVEN_SCENES if one.depth_camera is not None]
        return Recording(
            folder,
            tuple(chosen),
            lambda k, step: _sequence_pairs(poses or folder, k, step),
            lambda pose: read_seven_scenes(pose, folder),
            is_truth_of_depth=poses is None,
        )
    if poses is not None:
        raise ValueError(f"{folder}: expected frame-*.pose.txt (7-Scenes), where other poses are given, found none")
    if any(folder.glob("*/pose_prev.txt")):
        return Recording(folder, TUM_FR1, lambda k, step: _single_pairs(folder), read_tum_pair, gaps=(1,))
    raise ValueError(f"{folder}: expected frame-*.pose.txt (7-Scenes) or */pose_prev.txt (pairs), found neither")


def colmap_poses(folder: Path) -> Path | None:
    """Return the folder of COLMAP's poses beside a recording, None where there is none."""
    poses = folder.with_name(folder.name + COLMAP_POSES)
    return poses if poses.is_dir() else None


def _sequence_pairs(poses: Path, gap: int, step: int) -> list[tuple[Path, Path]]:
    files = sorted(poses.glob("frame-*.pose.txt"))
    return [(files[i], files[i + gap]) for i in range(0, len(files) - gap, step)]


def _single_pairs(folder: Path) -> list[tuple[Path, Path]]:
    return [(path, path.with_name("pose_curr.txt")) for path in sorted(folder.glob("*/pose_prev.txt"))]


@lru_cache(maxsize=32)
def read_seven_scenes(pose_path: Path, folder: Path) -> Frame:
    """Read the frame of a `frame-%06d.pose.txt` from a folder; colour is .jpg or .png, depth in mm."""
    stem = pose_path.name.removesuffix(".pose.txt")
    color = next((p for kind in ("jpg", "png") if (p := folder / f"{stem}.color.{kind}").exists()), None)
    if color is None:
        raise ValueError(f"{folder / stem}: expected .color.jpg or .color.png, found neither")
    depth = _read(folder / f"{stem}.depth.png", cv2.IMREAD_UNCHANGED)
    depth_m = np.where(np.isin(depth, INVALID_MM), np.nan, depth / 1000.0).astype(np.float32)
    return Frame(stem, _read(color, cv2.IMREAD_GRAYSCALE), depth_m, SE3.from_matrix(np.loadtxt(pose_path)))


@lru_cache(maxsize=32)
def read_tum_pair(pose_path: Path) -> Frame:
    """Read one half of a pair: `img_*.png`, `dep_*.png` in 1/5000 m, `pose_*.txt` as tx ty tz qx qy qz qw."""
    half = pose_path.stem.removeprefix("pose_")
    depth = _read(pose_path.with_name(f"dep_{half}.png"), cv2.IMREAD_UNCHANGED)
    depth_m = np.where(depth == 0, np.nan, depth / 5000.0).astype(np.float32)
    pose = np.loadtxt(pose_path)
    gray = _read(pose_path.with_name(f"img_{half}.png"), cv2.IMREAD_GRAYSCALE)
    return Frame(f"{pose_path.parent.name}/{half}", gray, depth_m, SE3.from_quaternion(pose[3:], pose[:3]))


def registered(frame: Frame, calibration: Calibration) -> Frame:
    """Carry depth into the colour image (nearest surface wins)."""
    source, camera = calibration.depth_camera, calibration.camera
    assert source is not None
    v, u = np.nonzero(np.isfinite(frame.depth_m))
    z = frame.depth_m[v, u].astype(np.float64)
    points = np.stack([(u - source.cx) / source.fx * z, (v - source.cy) / source.fy * z, z], axis=-1)
    points_color = calibration.T_color_depth.apply(points)
    pixels, visible = camera.project(points_color)
    far_first = np.argsort(-points_color[:, 2], kind="stable")
    far_first = far_first[visible[far_first]]
    column, row = np.rint(pixels[far_first]).astype(int).T
    depth_m = np.full(frame.depth_m.shape, np.nan, np.float32)
    depth_m[row, column] = points_color[far_first, 2]
    return replace(frame, depth_m=depth_m)


def _read(path: Path, flags: int) -> NDArray:
    image = cv2.imread(str(path), flags)
    if image is None:
        raise ValueError(f"{path}: expected a readable image, found none")
    return np.asarray(image)
