"""Calibrations that OpenCV's samples write with FileStorage (YAML), and ROS's camera_info files of the same fields.

One camera: camera_matrix, distortion_coefficients, image_width, image_height. A stereo pair: M1 D1 M2 D2, and R T in
the same or in a second file, with x_2 = R x_1 + T.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sphere_nav.geometry.arrays import Array, Size
from sphere_nav.geometry.cameras.camera import Camera
from sphere_nav.geometry.cameras.fisheye import Fisheye
from sphere_nav.geometry.cameras.pinhole import Pinhole
from sphere_nav.geometry.cameras.rig import NAME, RigCamera
from sphere_nav.geometry.files.foreign_cameras import camera_at, refuse_model
from sphere_nav.geometry.files.untrusted import (
    MAX_FILE_BYTES,
    ROTATION_TOLERANCE,
    load_yaml,
    number,
    read_as,
    read_text,
    short,
    told_at,
)
from sphere_nav.geometry.se3 import SE3

Values = Mapping[str, Any]

MATRICES = ("cameramatrix", "k", "m", "mtx")  # keys in small letters, without _ and -
FIRST = {f"{name}{number}" for name in MATRICES for number in ("", "1")}  # of which such a file has one, or R and T
DISTORTIONS = ("distortioncoefficients", "distcoeffs", "d", "dist")
SIZES = (("imagewidth", "imageheight"), ("width", "height"))
PINHOLE_MODELS = ("pinhole", "plumb_bob", "rational_polynomial", "radtan", "none")
FISHEYE_MODELS = ("fisheye", "equidistant")
NUM_PINHOLE = (0, 4, 5, 8, 12, 14)
MAX_SKEW = 1e-6
NOT_YAML = re.compile(r"\A%YAML.*|!!opencv-(nd-)?matrix")  # what OpenCV writes beside: its directive, and its tags


def load_opencv(path: Path) -> Any:
    """Return the values of a FileStorage in YAML, or of any other YAML or JSON."""
    text = read_text(path, "calibration file", MAX_FILE_BYTES)
    if text.lstrip().startswith("<"):
        raise ValueError(f"{path}: expected YAML or JSON, found XML (FileStorage writes YAML to names in .yml)")
    return load_yaml(path, NOT_YAML.sub("", text).replace("\t", " "))


def read_opencv(contents: Sequence[Any], image_size: Size | None, model: str | None, unit_m: float) -> list[RigCamera]:
    """Return one camera, or two, by the values of one file or of several that complete each other."""
    values: dict[str, Any] = {}
    for content in contents:
        found = _plain(content) if isinstance(content, dict) else {}
        if not (found.keys() & FIRST or found.keys() >= {"r", "t"}):
            raise ValueError(
                "expected a Kalibr camchain (cam0: ...), a basalt calibration (value0: ...) or an OpenCV calibration "
                f"(camera_matrix, M1, R and T), found {short(content)}"
            )
        if twice := sorted(values.keys() & found.keys()):
            raise ValueError(f"{twice[0]}: expected fields that the first file has not, found it again")
        values |= found
    return _cameras(values, image_size, model, unit_m)


def _plain(values: Values) -> dict[str, Any]:
    """Return the values by their keys in small letters without _ and -."""
    return {str(key).lower().replace("_", "").replace("-", ""): value for key, value in values.items()}


def _cameras(values: Values, image_size: Size | None, model: str | None, unit_m: float) -> list[RigCamera]:
    size_found = _size(values, image_size)
    chosen = _model(values, model)
    if any(name in values for name in MATRICES):
        named = str(values.get("cameraname") or "")
        name = named if NAME.fullmatch(named) else "camera"
        return [RigCamera(name, _camera(values, "", size_found, chosen), SE3.identity())]
    left, right = (_camera(values, suffix, size_found, chosen) for suffix in ("1", "2"))
    if "r" not in values or "t" not in values:
        raise ValueError("expected R and T of the second camera (extrinsics.yml beside intrinsics.yml), found none")
    T_right_left = _pose(_matrix(values["r"], "R"), _matrix(values["t"], "T"), unit_m)
    return [RigCamera("left", left, SE3.identity()), RigCamera("right", right, T_right_left.inverse())]


def _size(values: Values, given: Size | None) -> Size:
    for pair in SIZES:
        if all(name in values for name in pair):
            return read_as(int, values[pair[0]], pair[0]), read_as(int, values[pair[1]], pair[1])
    if given is None:
        raise ValueError("image_width, image_height: expected in the file, or --size, found neither")
    return given


def _model(values: Values, given: str | None) -> str:
    """Return pinhole or fisheye: what the user says, what the file says, or pinhole, OpenCV's own default."""
    told = given or values.get("distortionmodel") or ("fisheye" if values.get("fisheyemodel") else "pinhole")
    if told in FISHEYE_MODELS:
        return "fisheye"
    if told not in PINHOLE_MODELS:
        raise refuse_model(told, "distortion_model", ", ".join((*PINHOLE_MODELS, *FISHEYE_MODELS)))
    return "pinhole"


def _camera(values: Values, suffix: str, image_size: Size, model: str) -> Camera:
    key = next((name + suffix for name in MATRICES if name + suffix in values), None)
    if key is None:
        raise ValueError(f"M{suffix}: expected a camera matrix, found none")
    K = _matrix(values[key], key)
    if K.shape != (3, 3) or abs(K[0, 1]) > MAX_SKEW or K[1, 0] or K[2].tolist() != [0.0, 0.0, 1.0]:
        raise ValueError(f"{key}: expected [fx 0 cx; 0 fy cy; 0 0 1], found {short(K.tolist())}")
    found = next((values[name + suffix] for name in DISTORTIONS if name + suffix in values), None)
    k = () if found is None else tuple(float(value) for value in _matrix(found, f"distortion{suffix}").ravel())
    plane = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
    if model == "fisheye":
        return camera_at(key, image_size, plane, Fisheye, k)
    if len(k) not in NUM_PINHOLE:
        raise ValueError(f"distortion{suffix}: expected 4, 5, 8, 12 or 14 numbers, found {len(k)}")
    if any(k[8:]):
        raise refuse_model("thin prism or tilted sensor", f"distortion{suffix}", "k1 k2 p1 p2 k3 k4 k5 k6")
    return camera_at(key, image_size, plane, Pinhole, k[:8])


def _matrix(found: Any, where: str) -> Array:
    """Return a matrix of rows, cols and data, or a nested list."""
    is_told = isinstance(found, dict) and {"rows", "cols", "data"} <= set(found)
    table = np.array(found["data"] if is_told else found, dtype=object)
    shape = tuple(read_as(int, found[side], f"{where}.{side}") for side in ("rows", "cols")) if is_told else table.shape
    if len(shape) > 2 or table.size != math.prod(shape) or not table.size:
        raise ValueError(f"{where}: expected a matrix, found {table.size} numbers: {short(found)}")
    return np.array([number(value, where) for value in table.ravel()]).reshape(shape)


def _pose(R: Array, t: Array, unit_m: float) -> SE3:
    if t.size != 3 or R.shape != (3, 3):
        raise ValueError(f"R, T: expected 3 x 3 and 3 numbers, found {R.size} and {t.size}")
    with told_at("R"):
        return SE3.from_matrix(np.vstack([np.column_stack([R, unit_m * t.ravel()]), [0, 0, 0, 1]]), ROTATION_TOLERANCE)
