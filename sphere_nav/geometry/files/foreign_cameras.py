"""What readers of other programs' files share: lenses that are ours by another name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sphere_nav.geometry.arrays import Size
from sphere_nav.geometry.cameras.camera import Camera
from sphere_nav.geometry.cameras.rig import RigCamera
from sphere_nav.geometry.files.untrusted import check_center, short, told_at

Posed = tuple[list[RigCamera], bool]  # cameras, and whether they are posed on the IMU, else on the first of them


def camera_at(where: str, size: Size, plane: Sequence[float], model: Any, *more: Any) -> Camera:
    """Return a camera of one of our models, with what it has beyond its plane (fx, fy, cx, cy) in pixels.

    size: (width, height); where: the place in the file, for messages.
    """
    check_center((plane[2], plane[3]), size, where)
    with told_at(where):
        camera: Camera = model(*size, *plane, *more)
    return camera


def refuse_model(found: Any, where: str, known: str) -> ValueError:
    """Return the refusal of a model that has no equal here, by its name."""
    return ValueError(f"{where}: expected {known}, found {short(found)}, which is not supported")
