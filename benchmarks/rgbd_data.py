"""Recorded RGB-D images of 7-Scenes with COLMAP's poses of the colour camera: the recorded ones are wrong."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.partial.depth_registration import DepthRegistration
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.files.encoded import read_image_file
from sphere_nav_tools.offline.importing.files import read_meters, read_pose

CAMERA = Pinhole(640, 480, 525.0, 525.0, 320.0, 240.0)  # of colour
DEPTH_CAMERA = Pinhole(640, 480, 585.0, 585.0, 320.0, 240.0)
COLOUR_DEPTH = DepthRegistration(DEPTH_CAMERA, CAMERA, SE3.from_parts(np.eye(3), [-0.025, 0.0, 0.0]))
COLMAP_POSES = "_colmap_poses"  # folder beside a recording that has its name and this


@dataclass(frozen=True, eq=False)
class Frame:
    """One grey image with its depth along z in the same pixels, and the true pose of this camera."""

    name: str
    gray: NDArray[np.uint8]  # (H, W)
    depth_m: NDArray[np.float32]  # (H, W), NaN where not measured
    T_world_camera: SE3


@dataclass(frozen=True)
class Recording:
    """Frames by the files of their poses; images are read when asked for."""

    folder: Path
    poses: Path

    @classmethod
    def open(cls, data: Path) -> Recording | None:
        """Return the kitchen of a folder of recordings, None where it or its poses are not there."""
        folder = data / "rgbd" / "redkitchen"
        poses = folder.with_name(folder.name + COLMAP_POSES)
        return cls(folder, poses) if poses.is_dir() and folder.is_dir() else None

    def pairs(self, gap: int, step: int) -> list[tuple[Path, Path]]:
        """Return frames so far apart; `step` frames are between the starts of pairs."""
        files = sorted(self.poses.glob("frame-*.pose.txt"))
        return [(files[i], files[i + gap]) for i in range(0, len(files) - gap, step)]

    def frame(self, path: Path) -> Frame:
        """Return a frame, its depth as the colour camera sees it."""
        stem = path.name.removesuffix(".pose.txt")
        color = next((p for kind in ("jpg", "png") if (p := self.folder / f"{stem}.color.{kind}").exists()), None)
        if color is None:
            raise ValueError(f"{self.folder / stem}: expected .color.jpg or .color.png, found neither")
        gray = read_image_file(color, cv2.IMREAD_GRAYSCALE).astype(np.uint8)
        depth_m = COLOUR_DEPTH(read_meters(self.folder / f"{stem}.depth.png", 1000.0))
        return Frame(stem, gray, depth_m, read_pose(path))
