"""Where a camera sits on the vehicle, where /tf_static does not say: six numbers, or a file with them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from sphere_nav.geometry import SE3
from sphere_nav.geometry.files.untrusted import MAX_FILE_BYTES, load_yaml, numbers, read_text, short, told_at
from sphere_nav.geometry.plausible import check_mounting

NAMES = ("x", "y", "z", "roll", "pitch", "yaw")


def read_mounting(text: str, what: str = "mounting") -> SE3 | None:
    """Return T_base_camera in body axes (x ahead, y left, z up) from `x,y,z,roll,pitch,yaw` in m and rad, or a YAML.

    The file has these six names, or has them under `what`, as that of `sphere_nav refine-camera`. Turns are about the
    fixed axes of the vehicle, roll first, as static_transform_publisher has it. None for an empty text; ValueError for
    anything else.
    """
    if not text:
        return None
    return parse_mounting(_from_file(Path(text), what) if text.endswith((".yaml", ".yml")) else text.split(","), what)


def parse_mounting(values: object, what: str) -> SE3:
    """Return the place of six numbers; ValueError for anything else, and for a place that is on no vehicle."""
    try:
        x, y, z, roll, pitch, yaw = numbers(values, what, len(NAMES))
    except ValueError:
        raise ValueError(f"{what}: expected {','.join(NAMES)} (m, rad) or a YAML file, found {short(values)}") from None
    check_mounting(np.array([x, y, z]), what)
    return SE3.from_angles(roll, pitch, yaw, [x, y, z])


def _from_file(path: Path, what: str) -> list[Any]:
    with told_at(what):
        content = load_yaml(path, read_text(path, "YAML file", MAX_FILE_BYTES))
    if isinstance(content, dict):
        content = content.get(what, content)
    if not isinstance(content, dict) or set(content) != set(NAMES):
        found = short(list(content)) if isinstance(content, dict) else short(content)
        raise ValueError(f"{what}: {path}: expected {', '.join(NAMES)}, found {found}")
    return [content[name] for name in NAMES]
