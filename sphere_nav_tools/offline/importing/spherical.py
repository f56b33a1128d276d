"""Omnidirectional RGB-D: a ring of sensors (rgbd360) stitched into spheres, or equirectangular images with range."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from geometry_msgs.msg import TransformStamped
from numpy.typing import NDArray

from sphere_mapping.acquisition.partial.partial_sphere import RgbdView, sphere_from_views
from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.ros.conversions import se3_to_pose_stamped, se3_to_transform, sphere_to_message
from sphere_nav.spheres.sphere import Sphere
from sphere_nav_tools.offline.importing.recording import (
    BASE_FRAME,
    FIRST_STAMP_NS,
    MAP_FRAME,
    pose_of_row,
    read_depth_file,
    read_image,
    read_numbers,
    read_pose,
    require_folder,
)

SPHERE_FRAME = "sphere_link"
NUM_SENSORS = 8
SENSOR = Pinhole(320, 240, 262.5, 262.5, 159.5, 119.5)  # every Xtion of the ring
# Body axes (x forward, y left, z up) from those of the ring: its x points up, its z along the first sensor.
T_BODY_RIG = SE3(np.array([[0.0, 0, 1, 0], [0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 0, 1]]))


class SphereRecording:
    """Spheres one second apart, on the topic `sphere`."""

    def __init__(self, names: list[Path], poses: dict[Path, SE3], truth_name: str) -> None:
        self.names, self.poses, self.truth_name = names, poses, truth_name
        self.num_frames = len(names)

    def static_transforms(self, stamp: int) -> list[TransformStamped]:
        """Return base_link -> sphere_link (identity)."""
        return [se3_to_transform(SE3.identity(), stamp, BASE_FRAME, SPHERE_FRAME)]

    def stamp_ns(self, index: int) -> int:
        """Return the stamp of a sphere."""
        return FIRST_STAMP_NS + index * 1_000_000_000

    def frame(self, index: int) -> Iterator[tuple[str, Any]]:
        """Yield a sphere, and its true pose where it is known."""
        stamp, name = self.stamp_ns(index), self.names[index]
        if name in self.poses:
            yield "ground_truth/pose", se3_to_pose_stamped(self.poses[name], stamp, MAP_FRAME)
        yield "sphere", sphere_to_message(self.sphere(index, stamp), SPHERE_FRAME)

    def sphere(self, index: int, stamp: int) -> Sphere:
        """Return one sphere."""
        raise NotImplementedError


class RingRecording(SphereRecording):
    """sphere_*/rgb_k.png and depth_k.png (mm, registered) of eight sensors, Extrinsics/Rt_0k.txt, gicp_T_*_*.txt."""

    def __init__(self, folder: Path) -> None:
        names = sorted(require_folder(folder).glob("sphere_*"), key=lambda path: _number(path.name))
        self.T_body_sensor = [
            T_BODY_RIG @ read_pose(folder / "Extrinsics" / f"Rt_0{number}.txt") for number in range(1, NUM_SENSORS + 1)
        ]
        super().__init__(names, *_gicp_poses(folder, names))

    def sphere(self, index: int, stamp: int) -> Sphere:
        """Stitch the eight sensors into one sphere."""
        views, name = [], self.names[index]
        for number, T_body_sensor in enumerate(self.T_body_sensor, start=1):
            depth = read_depth_file(name / f"depth_{number}.png").astype(np.float32) / 1000
            color = _rgb(name / f"rgb_{number}.png")
            views.append(RgbdView(color, np.where(depth > 0, depth, np.nan), SENSOR, T_body_sensor))
        return sphere_from_views(views, stamp)


class EquirectangularRecording(SphereRecording):
    """image_*.png|jpg (2 H x H) with range_*.png: range along the ray in mm, 0 unknown, 65535 far; poses.tum."""

    def __init__(self, folder: Path) -> None:
        names = sorted((*folder.glob("image_*.png"), *folder.glob("image_*.jpg")), key=lambda path: _number(path.name))
        poses: dict[Path, SE3] = {}
        if (folder / "poses.tum").is_file():
            rows = read_numbers(folder / "poses.tum", 8)
            if len(rows) != len(names):
                raise ValueError(f"{folder / 'poses.tum'}: expected {len(names)} rows, one an image, found {len(rows)}")
            file = folder / "poses.tum"
            poses = {name: pose_of_row(row[1:], file) for name, row in zip(names, rows, strict=True)}
        super().__init__(names, poses, "poses.tum" if poses else "")

    def sphere(self, index: int, stamp: int) -> Sphere:
        """Read one sphere."""
        name = self.names[index]
        image = _rgb(name)
        file = name.with_name(name.stem.replace("image_", "range_", 1) + ".png")
        range_mm = read_depth_file(file)
        if range_mm.shape != image.shape[:2]:
            raise ValueError(
                f"{file}: expected {image.shape[1]} x {image.shape[0]} pixels, found {range_mm.shape[::-1]}"
            )
        return Sphere(image, _meters(range_mm), Spherical(image.shape[1], image.shape[0]), stamp)


def open_spherical(folder: Path) -> SphereRecording:
    """Open either layout, whichever is there."""
    if any(require_folder(folder).glob("image_*.*")):
        return EquirectangularRecording(folder)
    if not any(folder.glob("sphere_*")):
        raise ValueError(f"{folder}: expected folders sphere_* with Extrinsics, or files image_*.png, found neither")
    return RingRecording(folder)


def _gicp_poses(folder: Path, names: list[Path]) -> tuple[dict[Path, SE3], str]:
    """Return the poses of two spheres from gicp_T_<first>_<second>.txt, relative to the first."""
    for path in sorted(folder.glob("gicp_T_*_*.txt")):
        first, _, second = path.stem.removeprefix("gicp_T_").partition("_")
        found = {name.name.replace("_", ""): name for name in names}
        if first in found and second in found:
            T_first_second = T_BODY_RIG @ read_pose(path) @ T_BODY_RIG.inverse()
            return {found[first]: SE3.identity(), found[second]: T_first_second}, path.name
    return {}, ""


def _rgb(path: Path) -> NDArray[np.uint8]:
    """Return a grey (H, W) or RGB (H, W, 3) image."""
    image = read_image(path)
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB) if image.ndim == 3 else image


def _meters(range_mm: NDArray[np.uint16]) -> NDArray[np.float32]:
    range_m = range_mm.astype(np.float32) * np.float32(1e-3)
    range_m[range_mm == 0] = np.nan
    range_m[range_mm == np.iinfo(np.uint16).max] = np.inf
    return range_m


def _number(name: str) -> int:
    digits = re.search(r"\d+", name)
    return int(digits.group()) if digits else 0
