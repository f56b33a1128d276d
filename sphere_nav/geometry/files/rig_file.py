"""`rig.yaml`: a camera rig to read and to edit by hand. Whatever is wrong with it is told in one line."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import yaml

from sphere_nav.geometry.cameras.camera import Camera
from sphere_nav.geometry.cameras.double_sphere import DoubleSphere, Omni
from sphere_nav.geometry.cameras.pinhole import Fisheye, Pinhole
from sphere_nav.geometry.cameras.rig import Rig, RigCamera
from sphere_nav.geometry.files.untrusted import (
    MAX_FILE_BYTES,
    check_center,
    choice,
    load_yaml,
    mapping,
    number,
    numbers,
    pose,
    read_as,
    read_text,
    short,
    told_at,
)
from sphere_nav.geometry.files.whole_file import write_whole

FORMAT, FORMAT_VERSION = "sphere_nav_rig", 1
MODELS: dict[str, Any] = {model.model: model for model in (Pinhole, Fisheye, DoubleSphere, Omni)}
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
# omni: Mei's, xi and k1 k2 p1 p2 k3.
# mask: image of the camera's size, 0 where it must not be used; a relative path begins at this file's folder.
# exposure_group: cameras of one group share exposure and white balance. level: top, bottom, or empty (one sphere).
"""


def read_rig(path: str | Path) -> Rig:
    """Return the rig of a file; ValueError with file, field, expected and found in one line if it is none."""
    path = Path(path)
    return parse_rig(read_text(path, "rig file", MAX_FILE_BYTES), str(path), path.parent)


def parse_rig(text: str, where: str, folder: Path = Path()) -> Rig:
    """Return the rig of the text of a file; ValueError, with `where` it stands, if it is none."""
    found = load_yaml(where, text)
    with told_at(where):
        return _rig(mapping(found, "rig", RIG_FIELDS), folder)


def write_rig(path: str | Path, rig: Rig) -> None:
    """Write a rig, in the place of what is there."""
    write_whole(Path(path), rig_text(rig, Path(path).parent))


def rig_text(rig: Rig, folder: Path = Path()) -> str:
    """Return the text of a rig's file in a folder."""
    values = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "name": rig.name,
        "version": rig.version,
        "num_cameras": len(rig.cameras),
        "cameras": {part.name: _camera_values(part, folder) for part in rig.cameras},
    }
    text: str = yaml.safe_dump(values, sort_keys=False, default_flow_style=None, width=math.inf, allow_unicode=True)
    return HEADER + text


def _rig(values: Mapping[str, Any], folder: Path) -> Rig:
    if values["format"] != FORMAT or values["format_version"] != FORMAT_VERSION:
        found = f"{values['format']!s:.40} {values['format_version']!s:.40}"
        raise ValueError(f"format, format_version: expected {FORMAT} {FORMAT_VERSION}, found {found}")
    cameras = values["cameras"]
    if not isinstance(cameras, dict) or not cameras:
        raise ValueError(f"cameras: expected camera names with their fields, found {short(cameras)}")
    if values["num_cameras"] != len(cameras):
        found = f"{len(cameras)} ({', '.join(f'{name!s:.40}' for name in list(cameras)[:20])})"
        raise ValueError(f"cameras: expected {short(values['num_cameras'])} (num_cameras), found {found}")
    parts = tuple(_camera(str(name), fields, folder) for name, fields in cameras.items())
    return Rig(parts, str(values["name"]), str(values["version"]))


def _camera(name: str, fields: Any, folder: Path) -> RigCamera:
    values = mapping(fields, f"cameras.{name}", CAMERA_FIELDS, OPTIONAL)
    mask = values.get("mask")
    with told_at(f"cameras.{name}"):
        if mask is not None and not (folder / str(mask)).is_file():
            raise ValueError(f"mask: expected an image file, found no {mask}")
        path = None if mask is None else str(folder / str(mask))
        group, level = str(values.get("exposure_group") or ""), str(values.get("level") or "")
        return RigCamera(name, _model(values), pose(values["T_rig_camera"], "T_rig_camera"), path, group, level)


def _intrinsics(model: Any) -> list[str]:
    return [field.name for field in fields(model) if field.name not in ("width", "height", "distortion")]


def _model(values: Mapping[str, Any]) -> Camera:
    model = MODELS[choice(values["model"], "model", MODELS)]
    width, height = (read_as(int, values[side], side) for side in ("width", "height"))
    lens = mapping(values["intrinsics"], "intrinsics", _intrinsics(model))
    given: dict[str, Any] = {key: number(value, f"intrinsics.{key}") for key, value in lens.items()}
    check_center((given["cx"], given["cy"]), (width, height), "intrinsics")
    found = numbers(values.get("distortion") or [], "distortion")
    if found and model is DoubleSphere:
        raise ValueError(f"distortion: expected none for {model.model}, found {len(found)} numbers")
    given |= {"distortion": found} if found else {}
    camera: Camera = model(width, height, **given)
    return camera


def _camera_values(part: RigCamera, folder: Path) -> dict[str, Any]:
    camera = part.camera
    return {
        "model": camera.model,
        "width": camera.width,
        "height": camera.height,
        "intrinsics": {key: float(getattr(camera, key)) for key in _intrinsics(camera)},
        "distortion": [float(value) for value in getattr(camera, "distortion", ())],
        "T_rig_camera": part.T_rig_camera.matrix.tolist(),
        "mask": None if part.mask is None else _relative(part.mask, folder),
        "exposure_group": part.exposure_group,
        "level": part.level,
    }


def _relative(mask: str, folder: Path) -> str:
    path = Path(mask).absolute()
    return str(path.relative_to(folder.absolute())) if path.is_relative_to(folder.absolute()) else str(path)
