"""basalt's calibration JSON: poses `T_imu_cam`, lenses by `camera_type`, and sizes, one of each for a camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sphere_nav.geometry.arrays import Size
from sphere_nav.geometry.cameras.camera import Camera
from sphere_nav.geometry.cameras.double_sphere import DoubleSphere
from sphere_nav.geometry.cameras.fisheye import Fisheye
from sphere_nav.geometry.cameras.pinhole import Pinhole
from sphere_nav.geometry.cameras.rig import RigCamera
from sphere_nav.geometry.files.foreign_cameras import Posed, camera_at, refuse_model
from sphere_nav.geometry.files.untrusted import ROTATION_TOLERANCE, read_as, required
from sphere_nav.geometry.se3 import SE3

FURTHER: dict[str, tuple[str, ...]] = {
    "ds": ("xi", "alpha"),
    "ucm": ("alpha",),
    "kb4": ("k1", "k2", "k3", "k4"),
    "pinhole": (),
    "pinhole-radtan8": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
}
QUATERNION, POSITION = ("qx", "qy", "qz", "qw"), ("px", "py", "pz")


@dataclass(frozen=True)
class _Lens:
    camera_type: str
    intrinsics: dict[str, float]


@dataclass(frozen=True)
class _Calibration:
    T_imu_cam: tuple[dict[str, float], ...]
    intrinsics: tuple[_Lens, ...]
    resolution: tuple[Size, ...]


def is_basalt(values: Any) -> bool:
    """Whether these are the values of such a file."""
    return isinstance(values, dict) and "T_imu_cam" in _inner(values)


def read_basalt(values: Any) -> Posed:
    """Return the cameras of a calibration; `T_imu_cam` points as ours do."""
    found: _Calibration = read_as(_Calibration, _inner(values), "value0")
    counts = [len(found.T_imu_cam), len(found.intrinsics), len(found.resolution)]
    if len(set(counts)) > 1 or not counts[0]:
        told = "{} of T_imu_cam, {} of intrinsics, {} of resolution".format(*counts)
        raise ValueError(f"value0: expected one pose, lens and size for each camera, found {told}")
    parts = []
    for n, (pose, lens, size) in enumerate(zip(found.T_imu_cam, found.intrinsics, found.resolution, strict=True)):
        camera = _camera(lens, size, f"value0.intrinsics[{n}]")
        parts.append(RigCamera(f"cam{n}", camera, _place(pose, f"value0.T_imu_cam[{n}]")))
    return parts, True


def _inner(values: Mapping[str, Any]) -> Any:
    """Return what cereal, which writes these files, wraps in `value0`."""
    inner = values.get("value0", values)
    return inner if isinstance(inner, dict) else {}


def _camera(lens: _Lens, size: Size, where: str) -> Camera:
    kind = lens.camera_type
    if kind not in FURTHER:
        raise refuse_model(kind, f"{where}.camera_type", ", ".join(FURTHER))
    fields = ("fx", "fy", "cx", "cy", *FURTHER[kind])
    given = [required(lens.intrinsics, f"{where}.intrinsics", fields)[field] for field in fields]
    plane, more = given[:4], given[4:]
    model: tuple[Any, ...] = (Fisheye if kind == "kb4" else Pinhole), tuple(more)
    if kind in ("ds", "ucm"):
        model = DoubleSphere, *[0.0, *more][-2:]  # a unified camera is one whose two spheres coincide
    return camera_at(f"{where}.intrinsics", size, plane, *model)


def _place(pose: Mapping[str, float], where: str) -> SE3:
    given = required(pose, where, (*POSITION, *QUATERNION))
    xyzw = np.array([given[field] for field in QUATERNION])
    norm = float(np.linalg.norm(xyzw))
    if abs(norm - 1.0) > ROTATION_TOLERANCE:
        raise ValueError(f"{where}: expected a unit quaternion, found one of length {norm:.4g}")
    return SE3.from_quaternion(xyzw / norm, [given[field] for field in POSITION])
