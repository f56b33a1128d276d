"""Kalibr's camchain: cam0, cam1, ..., each placed relative to the one before it, to the IMU, or both."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from sphere_nav.geometry.arrays import Size
from sphere_nav.geometry.cameras.camera import Camera
from sphere_nav.geometry.cameras.double_sphere import DoubleSphere
from sphere_nav.geometry.cameras.fisheye import Fisheye
from sphere_nav.geometry.cameras.omni import Omni
from sphere_nav.geometry.cameras.pinhole import Pinhole
from sphere_nav.geometry.cameras.rig import RigCamera
from sphere_nav.geometry.files.foreign_cameras import Posed, camera_at, refuse_model
from sphere_nav.geometry.files.untrusted import numbers, pose, read_as, required
from sphere_nav.geometry.se3 import SE3

NAME = re.compile(r"cam([0-9]{1,3})")
NUM_INTRINSICS = {"pinhole": 4, "omni": 5, "ds": 6}  # fu fv pu pv, behind xi (omni) or xi alpha (ds)
NUM_DISTORTION = {"radtan": 4, "equidistant": 4, "none": 0}
KNOWN = "pinhole with radtan, equidistant or none, ds with none, omni with none or radtan"
AGREEMENT = 1e-3  # m and rad between a pose by the chain and the same by the IMU


def is_kalibr(values: Any) -> bool:
    """Whether these are the values of a camchain."""
    return isinstance(values, dict) and any(NAME.fullmatch(str(key)) for key in values)


def read_kalibr(values: Mapping[Any, Any]) -> Posed:
    """Return the cameras of a camchain (https://github.com/ethz-asl/kalibr/wiki/yaml-formats).

    `T_cn_cnm1` takes points of camera n - 1 to camera n, `T_cam_imu` points of the IMU to the camera; both point the
    other way than ours do.
    """
    names = sorted((str(key) for key in values if NAME.fullmatch(str(key))), key=lambda name: int(name[3:]))
    if names != [f"cam{number}" for number in range(len(names))]:
        raise ValueError(f"camchain: expected cam0 to cam{len(names) - 1}, found {', '.join(names)}")
    entries = {name: required(values[name], name, ("camera_model", "intrinsics", "resolution")) for name in names}
    cameras = [_camera(name, entry) for name, entry in entries.items()]
    poses, is_by_imu = _poses(entries)
    return list(map(RigCamera, names, cameras, poses)), is_by_imu


def _camera(name: str, entry: Mapping[str, Any]) -> Camera:
    model, distortion = entry["camera_model"], entry.get("distortion_model") or "none"
    if not isinstance(model, str) or model not in NUM_INTRINSICS:
        raise refuse_model(model, f"{name}.camera_model", KNOWN)
    is_known = isinstance(distortion, str) and distortion in NUM_DISTORTION
    if not is_known or (model != "pinhole" and distortion != "none" and (model, distortion) != ("omni", "radtan")):
        raise refuse_model(f"{model} with {distortion!s:.40}", f"{name}.distortion_model", KNOWN)
    given = numbers(entry["intrinsics"], f"{name}.intrinsics", NUM_INTRINSICS[model])
    k = numbers(entry.get("distortion_coeffs") or [], f"{name}.distortion_coeffs", NUM_DISTORTION[distortion])
    size: Size = read_as(Size, entry["resolution"], f"{name}.resolution")
    lens: tuple[Any, ...] = (Fisheye if distortion == "equidistant" else Pinhole), k
    if model != "pinhole":
        lens = (DoubleSphere, *given[:2]) if model == "ds" else (Omni, given[0], k)
    return camera_at(f"{name}.intrinsics", size, given[-4:], *lens)


def _by_imu(name: str, entry: Mapping[str, Any]) -> SE3 | None:
    """Return `T_imu_camera` where the file has it, one way or the other."""
    if "T_cam_imu" in entry:
        return pose(entry["T_cam_imu"], f"{name}.T_cam_imu").inverse()
    return pose(entry["T_imu_cam"], f"{name}.T_imu_cam") if "T_imu_cam" in entry else None


def _poses(entries: Mapping[str, Mapping[str, Any]]) -> tuple[list[SE3], bool]:
    """Return the poses relative to the IMU, or to cam0, and which of them it is; both ways must agree."""
    by_imu = {name: _by_imu(name, entry) for name, entry in entries.items()}
    first = by_imu["cam0"]
    poses = [SE3.identity() if first is None else first]
    for name, entry in list(entries.items())[1:]:
        told = by_imu[name] if first is not None else None
        chained = pose(entry["T_cn_cnm1"], f"{name}.T_cn_cnm1").inverse() if "T_cn_cnm1" in entry else None
        found = told if chained is None else poses[-1] @ chained
        if found is None:
            raise ValueError(f"{name}.T_cn_cnm1: expected a pose, found none, nor T_cam_imu of all cameras")
        if told is not None and (apart := float(np.max(found.distance(told)))) > AGREEMENT:
            expected = "what T_cn_cnm1 and the camera before it say"
            raise ValueError(f"{name}.T_cam_imu: expected {expected}, found a pose {apart:.3g} m or rad away")
        poses.append(found)
    return poses, first is not None
