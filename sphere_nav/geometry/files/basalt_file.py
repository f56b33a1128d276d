"""basalt's calibration JSON: poses `T_imu_cam`, lenses by `camera_type`, and sizes, one of each for a camera."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sphere_nav.geometry.cameras.camera import Camera
from sphere_nav.geometry.files.foreign_cameras import ForeignLens, ForeignRig, image_size, refuse_model
from sphere_nav.geometry.files.untrusted import MAX_FILE_BYTES, load_json, number, read_text, required, short, told_at
from sphere_nav.geometry.se3 import SE3

FIELDS = ("T_imu_cam", "intrinsics", "resolution")
CENTER = ("fx", "fy", "cx", "cy")
FURTHER: dict[str, tuple[str, ...]] = {
    "ds": ("xi", "alpha"),
    "ucm": ("alpha",),
    "kb4": ("k1", "k2", "k3", "k4"),
    "pinhole": (),
    "pinhole-radtan8": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
}
QUATERNION, POSITION = ("qx", "qy", "qz", "qw"), ("px", "py", "pz")
NORM_TOLERANCE = 1e-3


def is_basalt(values: Any) -> bool:
    """Whether these are the values of such a file."""
    return isinstance(values, dict) and "T_imu_cam" in _inner(values)


def read_basalt(path: Path) -> ForeignRig:
    """Return the cameras of a calibration of basalt; `T_imu_cam` points as ours do."""
    values = load_json(path, read_text(path, "basalt calibration", MAX_FILE_BYTES))
    with told_at(path):
        return _rig(values)


def _inner(values: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return what cereal, which writes these files, wraps in `value0`."""
    inner = values.get("value0", values)
    return inner if isinstance(inner, dict) else {}


def _rig(values: Any) -> ForeignRig:
    if not isinstance(values, dict):
        raise ValueError(f"calibration: expected value0 with {', '.join(FIELDS)}, found {short(values)}")
    inner = required(_inner(values), "value0", FIELDS)
    counts = {field: len(inner[field]) if isinstance(inner[field], list) else -1 for field in FIELDS}
    if len(set(counts.values())) > 1 or min(counts.values()) < 1:
        found = ", ".join(f"{count if count >= 0 else 'no list'} of {field}" for field, count in counts.items())
        raise ValueError(f"value0: expected one pose, lens and size for each camera, found {found}")
    numbers = range(counts["intrinsics"])
    poses = tuple(_pose(inner["T_imu_cam"][n], f"value0.T_imu_cam[{n}]") for n in numbers)
    cameras = tuple(_camera(inner["intrinsics"][n], inner["resolution"][n], n) for n in numbers)
    return ForeignRig(tuple(f"cam{n}" for n in numbers), cameras, poses, is_by_imu=True)


def _camera(entry: Any, resolution: Any, index: int) -> Camera:
    where = f"value0.intrinsics[{index}]"
    kind = required(entry, where, ("camera_type", "intrinsics"))["camera_type"]
    if not isinstance(kind, str) or kind not in FURTHER:
        raise refuse_model(kind, f"{where}.camera_type", ", ".join(FURTHER))
    fields = (*CENTER, *FURTHER[kind])
    given = required(entry["intrinsics"], f"{where}.intrinsics", fields)
    fx, fy, cx, cy, *more = (number(given[field], f"{where}.intrinsics.{field}") for field in fields)
    lens = ForeignLens(image_size(resolution, f"value0.resolution[{index}]"), fx, fy, cx, cy, f"{where}.intrinsics")
    if kind == "ds":
        return lens.double_sphere(*more)
    if kind == "ucm":
        return lens.to_unified(*more)
    return lens.fisheye(tuple(more)) if kind == "kb4" else lens.pinhole(tuple(more))


def _pose(entry: Any, where: str) -> SE3:
    given = required(entry, where, (*POSITION, *QUATERNION))
    xyzw = np.array([number(given[field], f"{where}.{field}") for field in QUATERNION])
    norm = float(np.linalg.norm(xyzw))
    if abs(norm - 1.0) > NORM_TOLERANCE:
        raise ValueError(f"{where}: expected a unit quaternion, found one of length {norm:.4g}")
    return SE3.from_quaternion(xyzw / norm, [number(given[field], f"{where}.{field}") for field in POSITION])
