"""`rig.yaml`: a camera rig to read and to edit by hand. Whatever is wrong with it is told in one line."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from sphere_geometry.camera import Camera
from sphere_geometry.double_sphere import DoubleSphere
from sphere_geometry.fisheye import Fisheye
from sphere_geometry.pinhole import Pinhole
from sphere_geometry.rig import Rig, RigCamera
from sphere_geometry.se3 import SE3

FORMAT, FORMAT_VERSION = "sphere_nav_rig", 1
ROTATION_TOLERANCE = 1e-4  # files are written with full precision; a hand's four digits still pass
MODELS: dict[str, tuple[str, ...]] = {
    "pinhole": ("fx", "fy", "cx", "cy"),
    "fisheye": ("fx", "fy", "cx", "cy"),
    "double_sphere": ("fx", "fy", "cx", "cy", "xi", "alpha"),
}
CAMERA_FIELDS = (
    "model",
    "width",
    "height",
    "intrinsics",
    "distortion",
    "T_rig_camera",
    "mask",
    "exposure_group",
    "level",
)
OPTIONAL = ("distortion", "mask", "exposure_group", "level")
RIG_FIELDS = ("format", "format_version", "name", "version", "num_cameras", "cameras")
HEADER = f"""\
# Camera rig. Metres and pixels; pixel centres are integers. T_rig_camera takes optical coordinates (x right, y down,
# z forward) to those of the rig (x forward, y left, z up).
# models: {", ".join(MODELS)}; distortion: up to 8 numbers (pinhole: k1 k2 p1 p2 k3 k4 k5 k6), 4 (fisheye: k1 k2 k3 k4).
# mask: image of the camera's size, 0 where it must not be used; a relative path begins at this file's folder.
# exposure_group: cameras of one group share exposure and white balance. level: top, bottom, or empty (one sphere).
"""


def read_rig(path: str | Path) -> Rig:
    """Return the rig of a file; ValueError with file, field, expected and found in one line if it is none."""
    path = Path(path)
    if not path.is_file():
        raise ValueError(f"{path}: expected a rig file, found {'a folder' if path.is_dir() else 'no such file'}")
    try:
        found = yaml.load(path.read_text(encoding="utf-8"), Loader=_StrictLoader)
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: expected YAML, found {' '.join(str(error).split())}") from None
    try:
        return _rig(_mapping(found, "rig", RIG_FIELDS), path.parent)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def write_rig(path: str | Path, rig: Rig, *, is_overwriting: bool = False) -> None:
    """Write a rig; a file that is there is replaced only if told so."""
    path = Path(path)
    if path.exists() and not is_overwriting:
        raise ValueError(f"{path}: expected no such file, found one: it is not overwritten")
    lines = [
        f"format: {FORMAT}",
        f"format_version: {FORMAT_VERSION}",
        f"name: {_word(rig.name)}",
        f"version: {_word(rig.version)}",
        f"num_cameras: {len(rig.cameras)}",
        "cameras:",
    ]
    for camera in rig.cameras:
        lines += _camera_lines(camera, path.parent)
    part = path.with_name(f".{path.name}.part")
    part.write_text(HEADER + "\n".join(lines) + "\n", encoding="utf-8")
    part.replace(path)


class _StrictLoader(yaml.SafeLoader):  # type: ignore[misc]
    """Refuses a key that comes twice, which YAML would pass over."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]
        for key in keys:
            if keys.count(key) > 1:
                raise yaml.constructor.ConstructorError(None, None, f"{key!r} twice", node.start_mark)
        return dict(super().construct_mapping(node, deep))


def _rig(values: Mapping[str, Any], folder: Path) -> Rig:
    if values["format"] != FORMAT or values["format_version"] != FORMAT_VERSION:
        found = f"{values['format']} {values['format_version']}"
        raise ValueError(f"format, format_version: expected {FORMAT} {FORMAT_VERSION}, found {found}")
    cameras = values["cameras"]
    if not isinstance(cameras, dict) or not cameras:
        raise ValueError(f"cameras: expected camera names with their fields, found {_short(cameras)}")
    if values["num_cameras"] != len(cameras):
        found = f"{len(cameras)} ({', '.join(str(name) for name in cameras)})"
        raise ValueError(f"cameras: expected {values['num_cameras']} (num_cameras), found {found}")
    parts = tuple(_camera(str(name), fields, folder) for name, fields in cameras.items())
    return Rig(parts, str(values["name"]), str(values["version"]))


def _camera(name: str, fields: Any, folder: Path) -> RigCamera:
    where = f"cameras.{name}"
    values = _mapping(fields, where, CAMERA_FIELDS, OPTIONAL)
    mask = values.get("mask")
    if mask is not None and not (folder / str(mask)).is_file():
        raise ValueError(f"{where}.mask: expected an image file, found no {mask}")
    pose = _pose(values["T_rig_camera"], f"{where}.T_rig_camera")
    path = None if mask is None else str(folder / str(mask))
    group, level = str(values.get("exposure_group") or ""), str(values.get("level") or "")
    try:
        return RigCamera(name, _model(values, where), pose, path, group, level)
    except ValueError as error:
        text = str(error)
        raise ValueError(text if text.startswith(where) else f"{where}: {text}") from None


def _model(values: Mapping[str, Any], where: str) -> Camera:
    name = values["model"]
    if name not in MODELS:
        raise ValueError(f"{where}.model: expected {', '.join(MODELS)}, found {_short(name)}")
    width, height = (_size(values[side], f"{where}.{side}") for side in ("width", "height"))
    lens = _mapping(values["intrinsics"], f"{where}.intrinsics", MODELS[name])
    fx, fy, cx, cy, *others = (_number(lens[key], f"{where}.intrinsics.{key}") for key in MODELS[name])
    _check_centre(cx, cy, width, height, where)
    found = values.get("distortion") or []
    if not isinstance(found, list):
        raise ValueError(f"{where}.distortion: expected a list of numbers, found {_short(found)}")
    distortion = tuple(_number(value, f"{where}.distortion") for value in found)
    if name == "pinhole":
        return Pinhole(width, height, fx, fy, cx, cy, distortion)
    if name == "fisheye":
        k = distortion or (0.0, 0.0, 0.0, 0.0)
        if len(k) != 4:
            raise ValueError(f"{where}.distortion: expected 4 numbers, found {len(k)}")
        return Fisheye(width, height, fx, fy, cx, cy, (k[0], k[1], k[2], k[3]))
    if distortion:
        raise ValueError(f"{where}.distortion: expected none for double_sphere, found {len(distortion)} numbers")
    return DoubleSphere(width, height, fx, fy, cx, cy, *others)


def _check_centre(cx: float, cy: float, width: int, height: int, where: str) -> None:
    if not (0 <= cx < width and 0 <= cy < height):
        expected = f"the centre inside the {width} x {height} image"
        raise ValueError(f"{where}.intrinsics: expected {expected}, found cx {cx}, cy {cy}: of another image size?")


def _pose(found: Any, where: str) -> SE3:
    try:
        matrix = np.array(found, dtype=np.float64)
    except (ValueError, TypeError):
        raise ValueError(f"{where}: expected 4 rows of 4 numbers, found {_short(found)}") from None
    if matrix.shape != (4, 4):
        raise ValueError(f"{where}: expected 4 rows of 4 numbers, found shape {matrix.shape}")
    try:
        return SE3.from_matrix(matrix, ROTATION_TOLERANCE)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None


def _mapping(found: Any, where: str, fields: tuple[str, ...], optional: tuple[str, ...] = ()) -> Mapping[str, Any]:
    if not isinstance(found, dict):
        raise ValueError(f"{where}: expected the fields {', '.join(fields)}, found {_short(found)}")
    for field in fields:
        if field not in found and field not in optional:
            raise ValueError(f"{where}.{field}: expected a value, found none")
    for field in found:
        if field not in fields:
            raise ValueError(f"{where}.{field}: expected only {', '.join(fields)}, found this field")
    return found


def _number(found: Any, where: str) -> float:
    if isinstance(found, bool) or not isinstance(found, int | float) or not np.isfinite(found):
        raise ValueError(f"{where}: expected a finite number, found {_short(found)}")
    return float(found)


def _size(found: Any, where: str) -> int:
    if isinstance(found, bool) or not isinstance(found, int) or found < 1:
        raise ValueError(f"{where}: expected a positive number of pixels, found {_short(found)}")
    return found


def _short(found: Any) -> str:
    text = " ".join(repr(found).split())
    return text if len(text) <= 60 else text[:57] + "..."


def _camera_lines(part: RigCamera, folder: Path) -> list[str]:
    camera = part.camera
    if camera.model not in MODELS:
        raise ValueError(f"{part.name}: expected a camera of {', '.join(MODELS)}, found {camera.model}")
    lens = ", ".join(f"{key}: {float(getattr(camera, key))!r}" for key in MODELS[camera.model])
    distortion = ", ".join(repr(float(value)) for value in getattr(camera, "distortion", ()))
    rows = [", ".join(repr(float(value)) for value in row) for row in part.T_rig_camera.matrix]
    return [
        f"  {part.name}:",
        f"    model: {camera.model}",
        f"    width: {camera.width}",
        f"    height: {camera.height}",
        f"    intrinsics: {{{lens}}}",
        f"    distortion: [{distortion}]",
        "    T_rig_camera:",
        *(f"      - [{row}]" for row in rows),
        f"    mask: {'null' if part.mask is None else _word(_relative(part.mask, folder))}",
        f"    exposure_group: {_word(part.exposure_group)}",
        f"    level: {_word(part.level)}",
    ]


def _relative(mask: str, folder: Path) -> str:
    path = Path(mask).absolute()
    return str(path.relative_to(folder.absolute())) if path.is_relative_to(folder.absolute()) else str(path)


def _word(text: str) -> str:
    """Return the text as YAML reads it back as a string."""
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
