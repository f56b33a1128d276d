"""Rigs in the files of other programs: Kalibr's camchain, basalt's calibration, OpenCV's FileStorage.

Kalibr places cam0, cam1, ... each relative to the one before it, to the IMU, or both. basalt's JSON has poses
`T_imu_cam`, lenses by `camera_type`, and sizes, one of each for a camera. What OpenCV's samples write in YAML, and ROS
as camera_info, has of one camera camera_matrix, distortion_coefficients, image_width, image_height; of a stereo pair
M1 D1 M2 D2, and R T in the same or in a second file, with x_2 = R x_1 + T.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from sphere_nav.geometry.arrays import Array, Size
from sphere_nav.geometry.cameras.camera import Camera
from sphere_nav.geometry.cameras.double_sphere import DoubleSphere, Omni
from sphere_nav.geometry.cameras.pinhole import Fisheye, Pinhole
from sphere_nav.geometry.cameras.rig import NAME, T_BODY_OPTICAL, Rig, RigCamera
from sphere_nav.geometry.files.untrusted import (
    MAX_FILE_BYTES,
    ROTATION_TOLERANCE,
    check_center,
    load_yaml,
    number,
    numbers,
    pose,
    read_as,
    read_text,
    required,
    short,
    told_at,
)
from sphere_nav.geometry.se3 import SE3

FRAMES = ("camera", "imu")
Values = Mapping[str, Any]
Posed = tuple[list[RigCamera], bool]  # cameras, and whether they are posed on the IMU, else on the first of them

# --- Kalibr
CAMERA = re.compile(r"cam([0-9]{1,3})")
NUM_INTRINSICS = {"pinhole": 4, "omni": 5, "ds": 6}  # fu fv pu pv, behind xi (omni) or xi alpha (ds)
NUM_DISTORTION = {"radtan": 4, "equidistant": 4, "none": 0}
KNOWN = "pinhole with radtan, equidistant or none, ds with none, omni with none or radtan"
AGREEMENT = 1e-3  # m and rad between a pose by the chain and the same by the IMU
# --- basalt
FURTHER: dict[str, tuple[str, ...]] = {
    "ds": ("xi", "alpha"),
    "ucm": ("alpha",),
    "kb4": ("k1", "k2", "k3", "k4"),
    "pinhole": (),
    "pinhole-radtan8": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
}
QUATERNION, POSITION = ("qx", "qy", "qz", "qw"), ("px", "py", "pz")
# --- OpenCV
MATRICES = ("cameramatrix", "k", "m", "mtx")  # keys in small letters, without _ and -
FIRST = {f"{name}{number}" for name in MATRICES for number in ("", "1")}  # of which such a file has one, or R and T
DISTORTIONS = ("distortioncoefficients", "distcoeffs", "d", "dist")
SIZES = (("imagewidth", "imageheight"), ("width", "height"))
PINHOLE_MODELS = ("pinhole", "plumb_bob", "rational_polynomial", "radtan", "none")
FISHEYE_MODELS = ("fisheye", "equidistant")
NUM_PINHOLE = (0, 4, 5, 8, 12, 14)
MAX_SKEW = 1e-6
NOT_YAML = re.compile(r"\A%YAML.*|!!opencv-(nd-)?matrix")  # what OpenCV writes beside: its directive, and its tags


def read_foreign_rig(
    paths: Sequence[Path],
    frame: str = "camera",
    image_size: Size | None = None,
    model: str | None = None,
    unit_m: float = 1.0,
) -> Rig:
    """Return the cameras of one file, or of the two of OpenCV's stereo sample; ValueError in one line for none.

    frame: "camera" for the first one level and ahead, "imu" for the IMU's axes. image_size (width, height), model
    (pinhole, fisheye) and unit_m, the length of the file's unit in metres, are what OpenCV's files may not tell.
    """
    contents = [load_foreign(path) for path in paths]
    with told_at(" ".join(map(str, paths))):
        first = contents[0] if isinstance(contents[0], dict) else {}
        basalt = first.get("value0", first)  # cereal, which writes these files, wraps them
        is_kalibr = any(CAMERA.fullmatch(str(key)) for key in first)
        is_basalt = isinstance(basalt, dict) and "T_imu_cam" in basalt
        if (is_kalibr or is_basalt) and len(contents) > 1:
            raise ValueError(f"expected one file of Kalibr or basalt, found {len(contents)}")
        if is_kalibr:
            cameras, is_by_imu = _read_kalibr(first)
        elif is_basalt:
            cameras, is_by_imu = _read_basalt(basalt)
        else:
            cameras, is_by_imu = _read_opencv(contents, image_size, model, unit_m), False
        if frame == "imu" and not is_by_imu:
            raise ValueError("expected poses relative to an IMU (--frame imu), found none")
        T_rig_origin = SE3.identity() if frame == "imu" else T_BODY_OPTICAL @ cameras[0].T_rig_camera.inverse()
        parts = [replace(part, T_rig_camera=T_rig_origin @ part.T_rig_camera) for part in cameras]
        return Rig(tuple(parts), paths[0].stem)


def load_foreign(path: Path) -> Any:
    """Return the values of a FileStorage in YAML, or of any other YAML or JSON."""
    text = read_text(path, "calibration file", MAX_FILE_BYTES)
    if text.lstrip().startswith("<"):
        raise ValueError(f"{path}: expected YAML or JSON, found XML (FileStorage writes YAML to names in .yml)")
    return load_yaml(path, NOT_YAML.sub("", text).replace("\t", " "))


def _camera(where: str, size: Size, plane: Sequence[float], model: Any, *more: Any) -> Camera:
    """Return a camera of one of our models, with what it has beyond its plane (fx, fy, cx, cy) in pixels."""
    check_center((plane[2], plane[3]), size, where)
    with told_at(where):
        camera: Camera = model(*size, *plane, *more)
    return camera


def _refuse_model(found: Any, where: str, known: str) -> ValueError:
    """Return the refusal of a model that has no equal here, by its name."""
    return ValueError(f"{where}: expected {known}, found {short(found)}, which is not supported")


# --- Kalibr
def _read_kalibr(values: Values) -> Posed:
    """Return the cameras of a camchain (https://github.com/ethz-asl/kalibr/wiki/yaml-formats).

    `T_cn_cnm1` takes points of camera n - 1 to camera n, `T_cam_imu` points of the IMU to the camera; both point the
    other way than ours do.
    """
    names = sorted((str(key) for key in values if CAMERA.fullmatch(str(key))), key=lambda name: int(name[3:]))
    if names != [f"cam{number}" for number in range(len(names))]:
        raise ValueError(f"camchain: expected cam0 to cam{len(names) - 1}, found {', '.join(names)}")
    entries = {name: required(values[name], name, ("camera_model", "intrinsics", "resolution")) for name in names}
    cameras = [_kalibr_camera(name, entry) for name, entry in entries.items()]
    poses, is_by_imu = _kalibr_poses(entries)
    return list(map(RigCamera, names, cameras, poses)), is_by_imu


def _kalibr_camera(name: str, entry: Values) -> Camera:
    model, distortion = entry["camera_model"], entry.get("distortion_model") or "none"
    if not isinstance(model, str) or model not in NUM_INTRINSICS:
        raise _refuse_model(model, f"{name}.camera_model", KNOWN)
    is_known = isinstance(distortion, str) and distortion in NUM_DISTORTION
    if not is_known or (model != "pinhole" and distortion != "none" and (model, distortion) != ("omni", "radtan")):
        raise _refuse_model(f"{model} with {distortion!s:.40}", f"{name}.distortion_model", KNOWN)
    given = numbers(entry["intrinsics"], f"{name}.intrinsics", NUM_INTRINSICS[model])
    k = numbers(entry.get("distortion_coeffs") or [], f"{name}.distortion_coeffs", NUM_DISTORTION[distortion])
    size: Size = read_as(Size, entry["resolution"], f"{name}.resolution")
    lens: tuple[Any, ...] = (Fisheye if distortion == "equidistant" else Pinhole), k
    if model != "pinhole":
        lens = (DoubleSphere, *given[:2]) if model == "ds" else (Omni, given[0], k)
    return _camera(f"{name}.intrinsics", size, given[-4:], *lens)


def _kalibr_poses(entries: Mapping[str, Values]) -> tuple[list[SE3], bool]:
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


def _by_imu(name: str, entry: Values) -> SE3 | None:
    """Return `T_imu_camera` where the file has it, one way or the other."""
    if "T_cam_imu" in entry:
        return pose(entry["T_cam_imu"], f"{name}.T_cam_imu").inverse()
    return pose(entry["T_imu_cam"], f"{name}.T_imu_cam") if "T_imu_cam" in entry else None


# --- basalt
@dataclass(frozen=True)
class _Lens:
    camera_type: str
    intrinsics: dict[str, float]


@dataclass(frozen=True)
class _Calibration:
    T_imu_cam: tuple[dict[str, float], ...]
    intrinsics: tuple[_Lens, ...]
    resolution: tuple[Size, ...]


def _read_basalt(values: Values) -> Posed:
    """Return the cameras of a calibration; `T_imu_cam` points as ours do."""
    found: _Calibration = read_as(_Calibration, values, "value0")
    counts = [len(found.T_imu_cam), len(found.intrinsics), len(found.resolution)]
    if len(set(counts)) > 1 or not counts[0]:
        told = "{} of T_imu_cam, {} of intrinsics, {} of resolution".format(*counts)
        raise ValueError(f"value0: expected one pose, lens and size for each camera, found {told}")
    parts = []
    for n, (placed, lens, size) in enumerate(zip(found.T_imu_cam, found.intrinsics, found.resolution, strict=True)):
        camera = _basalt_camera(lens, size, f"value0.intrinsics[{n}]")
        parts.append(RigCamera(f"cam{n}", camera, _basalt_pose(placed, f"value0.T_imu_cam[{n}]")))
    return parts, True


def _basalt_camera(lens: _Lens, size: Size, where: str) -> Camera:
    kind = lens.camera_type
    if kind not in FURTHER:
        raise _refuse_model(kind, f"{where}.camera_type", ", ".join(FURTHER))
    fields = ("fx", "fy", "cx", "cy", *FURTHER[kind])
    given = [required(lens.intrinsics, f"{where}.intrinsics", fields)[field] for field in fields]
    plane, more = given[:4], given[4:]
    model: tuple[Any, ...] = (Fisheye if kind == "kb4" else Pinhole), tuple(more)
    if kind in ("ds", "ucm"):
        model = DoubleSphere, *[0.0, *more][-2:]  # a unified camera is one whose two spheres coincide
    return _camera(f"{where}.intrinsics", size, plane, *model)


def _basalt_pose(placed: Mapping[str, float], where: str) -> SE3:
    given = required(placed, where, (*POSITION, *QUATERNION))
    xyzw = np.array([given[field] for field in QUATERNION])
    norm = float(np.linalg.norm(xyzw))
    if abs(norm - 1.0) > ROTATION_TOLERANCE:
        raise ValueError(f"{where}: expected a unit quaternion, found one of length {norm:.4g}")
    return SE3.from_quaternion(xyzw, [given[field] for field in POSITION])


# --- OpenCV
def _read_opencv(contents: Sequence[Any], image_size: Size | None, model: str | None, unit_m: float) -> list[RigCamera]:
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
    size, chosen = _opencv_size(values, image_size), _opencv_model(values, model)
    if any(name in values for name in MATRICES):
        named = str(values.get("cameraname") or "")
        name = named if NAME.fullmatch(named) else "camera"
        return [RigCamera(name, _opencv_camera(values, "", size, chosen), SE3.identity())]
    left, right = (_opencv_camera(values, suffix, size, chosen) for suffix in ("1", "2"))
    if "r" not in values or "t" not in values:
        raise ValueError("expected R and T of the second camera (extrinsics.yml beside intrinsics.yml), found none")
    T_right_left = _opencv_pose(_matrix(values["r"], "R"), _matrix(values["t"], "T"), unit_m)
    return [RigCamera("left", left, SE3.identity()), RigCamera("right", right, T_right_left.inverse())]


def _plain(values: Values) -> dict[str, Any]:
    """Return the values by their keys in small letters without _ and -."""
    return {str(key).lower().replace("_", "").replace("-", ""): value for key, value in values.items()}


def _opencv_size(values: Values, given: Size | None) -> Size:
    for pair in SIZES:
        if all(name in values for name in pair):
            return read_as(int, values[pair[0]], pair[0]), read_as(int, values[pair[1]], pair[1])
    if given is None:
        raise ValueError("image_width, image_height: expected in the file, or --size, found neither")
    return given


def _opencv_model(values: Values, given: str | None) -> str:
    """Return pinhole or fisheye: what the user says, what the file says, or pinhole, OpenCV's own default."""
    told = given or values.get("distortionmodel") or ("fisheye" if values.get("fisheyemodel") else "pinhole")
    if told in FISHEYE_MODELS:
        return "fisheye"
    if told not in PINHOLE_MODELS:
        raise _refuse_model(told, "distortion_model", ", ".join((*PINHOLE_MODELS, *FISHEYE_MODELS)))
    return "pinhole"


def _opencv_camera(values: Values, suffix: str, image_size: Size, model: str) -> Camera:
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
        return _camera(key, image_size, plane, Fisheye, k)
    if len(k) not in NUM_PINHOLE:
        raise ValueError(f"distortion{suffix}: expected 4, 5, 8, 12 or 14 numbers, found {len(k)}")
    if any(k[8:]):
        raise _refuse_model("thin prism or tilted sensor", f"distortion{suffix}", "k1 k2 p1 p2 k3 k4 k5 k6")
    return _camera(key, image_size, plane, Pinhole, k[:8])


def _matrix(found: Any, where: str) -> Array:
    """Return a matrix of rows, cols and data, or a nested list."""
    is_told = isinstance(found, dict) and {"rows", "cols", "data"} <= set(found)
    table = np.array(found["data"] if is_told else found, dtype=object)
    shape = tuple(read_as(int, found[side], f"{where}.{side}") for side in ("rows", "cols")) if is_told else table.shape
    if len(shape) > 2 or table.size != math.prod(shape) or not table.size:
        raise ValueError(f"{where}: expected a matrix, found {table.size} numbers: {short(found)}")
    return np.array([number(value, where) for value in table.ravel()]).reshape(shape)


def _opencv_pose(R: Array, t: Array, unit_m: float) -> SE3:
    if t.size != 3 or R.shape != (3, 3):
        raise ValueError(f"R, T: expected 3 x 3 and 3 numbers, found {R.size} and {t.size}")
    with told_at("R"):
        return SE3.from_matrix(np.vstack([np.column_stack([R, unit_m * t.ravel()]), [0, 0, 0, 1]]), ROTATION_TOLERANCE)
