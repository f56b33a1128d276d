"""Recorded RGB-D images of 7-Scenes with COLMAP's poses of the colour camera: the recorded ones are wrong."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import SE3, Pinhole

CAMERA = Pinhole(640, 480, 525.0, 525.0, 320.0, 240.0)  # of colour
DEPTH_CAMERA = Pinhole(640, 480, 585.0, 585.0, 320.0, 240.0)
OFFSET_M = (-0.025, 0.0, 0.0)  # X_colour = X_depth + offset
INVALID_MM = (0, 65535)  # 7-Scenes writes both where the sensor saw nothing
COLMAP_POSES = "_colmap_poses"  # folder beside a recording that has its name and this


@dataclass(frozen=True, eq=False)
class Frame:
    """One grey image with its depth along z in the same pixels, and the true pose of this camera."""

    name: str
    gray: NDArray[np.uint8]  # (H, W)
    depth_m: NDArray[np.float32]  # (H, W), NaN where not measured
    T_world_camera: SE3


def colmap_poses(folder: Path) -> Path | None:
    """Return the folder of COLMAP's poses beside a recording, None where there is none."""
    poses = folder.with_name(folder.name + COLMAP_POSES)
    return poses if poses.is_dir() else None


@dataclass(frozen=True)
class Recording:
    """Frames by the files of their poses; images are read when asked for."""

    folder: Path
    poses: Path

    @classmethod
    def open(cls, data: Path) -> Recording | None:
        """Return the kitchen of a folder of recordings, None where it or its poses are not there."""
        folder = data / "rgbd" / "redkitchen"
        poses = colmap_poses(folder)
        return cls(folder, poses) if poses is not None and folder.is_dir() else None

    def pairs(self, gap: int, step: int) -> list[tuple[Path, Path]]:
        """Return frames so far apart; `step` frames are between the starts of pairs."""
        files = sorted(self.poses.glob("frame-*.pose.txt"))
        return [(files[i], files[i + gap]) for i in range(0, len(files) - gap, step)]

    def frame(self, path: Path) -> Frame:
        """Return a frame, its depth carried into the colour image (nearest surface wins)."""
        return _read(path, self.folder)


@lru_cache(maxsize=32)
def _read(path: Path, folder: Path) -> Frame:
    stem = path.name.removesuffix(".pose.txt")
    color = next((p for kind in ("jpg", "png") if (p := folder / f"{stem}.color.{kind}").exists()), None)
    if color is None:
        raise ValueError(f"{folder / stem}: expected .color.jpg or .color.png, found neither")
    depth, gray = (
        cv2.imread(str(folder / f"{stem}.depth.png"), cv2.IMREAD_UNCHANGED),
        cv2.imread(str(color), cv2.IMREAD_GRAYSCALE),
    )
    if depth is None or gray is None:
        raise ValueError(f"{folder / stem}: expected readable images, found none")
    depth_m = np.where(np.isin(depth, INVALID_MM), np.nan, depth / 1000.0).astype(np.float32)
    return Frame(stem, gray.astype(np.uint8), _registered(depth_m), SE3.from_matrix(np.loadtxt(path)))


def _registered(depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
    v, u = np.nonzero(np.isfinite(depth_m))
    z = depth_m[v, u].astype(np.float64)
    points = np.stack([(u - DEPTH_CAMERA.cx) / DEPTH_CAMERA.fx, (v - DEPTH_CAMERA.cy) / DEPTH_CAMERA.fy], axis=-1)
    points = np.column_stack([points * z[:, None], z]) + OFFSET_M
    pixels, visible = CAMERA.project(points)
    far_first = np.argsort(-points[:, 2], kind="stable")
    far_first = far_first[visible[far_first]]
    column, row = np.rint(pixels[far_first]).astype(int).T
    found = np.full(depth_m.shape, np.nan, np.float32)
    found[row, column] = points[far_first, 2]
    return found
