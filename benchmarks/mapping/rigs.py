"""Recorded rigs: their calibration files as a Rig, their images in RGB."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import SE3, DoubleSphere, Pinhole, Rig, RigCamera
from sphere_nav.spheres.sphere import T_BODY_OPTICAL

Image = NDArray[np.uint8]
OWN_CAR = ((-1.5, -1.2, 0.0), (4.0, 1.2, 2.2))  # m: box around the car of nuscenes, whose own roof its LiDAR sees


def room(folder: Path) -> tuple[Image, Image]:
    """Return the top and the bottom sphere."""
    return _rgb(folder / "top.png"), _rgb(folder / "bottom.png")


def fisheye_rig(folder: Path) -> tuple[Rig, dict[str, Image], dict[str, Image]]:
    """Return four fisheyes in two back-to-back pairs, their images and masks; the first camera looks ahead, level."""
    values: Any = json.loads((folder / "calibration.json").read_text())["value0"]
    cameras, images, masks = [], {}, {}
    for number, (pose, lens, size) in enumerate(
        zip(values["T_imu_cam"], values["intrinsics"], values["resolution"], strict=True)
    ):
        name = f"cam{number}"
        T_imu_camera = SE3.from_quaternion(
            [pose[k] for k in ("qx", "qy", "qz", "qw")], [pose[k] for k in ("px", "py", "pz")]
        )
        numbers = (lens["intrinsics"][k] for k in ("fx", "fy", "cx", "cy", "xi", "alpha"))
        level = "bottom" if number < 2 else "top"  # the first camera's y points down, the second pair is above it
        pose_rig = T_BODY_OPTICAL @ T_imu_camera
        cameras.append(RigCamera(name, DoubleSphere(*size, *numbers), pose_rig, level=level))
        images[name] = _rgb(folder / name / "0.jpg")
        masks[name] = cv2.imread(str(folder / name / "mask.png"), cv2.IMREAD_GRAYSCALE).astype(np.uint8)
    return Rig(tuple(cameras), "fisheye_rig"), images, masks


def nuscenes(folder: Path) -> tuple[Rig, dict[str, Image], NDArray[np.float64]]:
    """Return six cameras around a car, their images, and a LiDAR sweep (N, 3) in the frame of the car.

    The car drives, and no two cameras expose at one time: each is where it was at its own stamp, in the frame that the
    car had at the LiDAR's (up to 0.4 m from where it is mounted).
    """
    values: Any = json.loads((folder / "calibration.json").read_text())
    T_ego_lidar = SE3.from_matrix(values["lidar"]["lidar2ego"], 1e-3)
    cameras, images = [], {}
    for name, entry in values["cameras"].items():
        K, (width, height) = entry["K"], entry["size"]
        pose = T_ego_lidar @ SE3.from_matrix(entry["lidar2cam_motion_compensated"], 1e-3).inverse()
        camera = Pinhole(width, height, K[0][0], K[1][1], K[0][2], K[1][2])
        cameras.append(RigCamera(name, camera, pose))
        images[name] = _rgb(folder / entry["file"])
    points = np.fromfile(folder / values["lidar"]["file"], np.float32).reshape(-1, 5)[:, :3].astype(np.float64)
    points = T_ego_lidar.apply(points)
    is_own = np.all((points > OWN_CAR[0]) & (points < OWN_CAR[1]), axis=1)
    return Rig(tuple(cameras), "nuscenes"), images, points[~is_own]


def _rgb(path: Path) -> Image:
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        raise ValueError(f"{path}: expected an image, found none")
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB).astype(np.uint8)
