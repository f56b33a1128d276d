"""What readers of other programs' files share: cameras with poses, and lenses that are ours by another name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sphere_nav.geometry.cameras.camera import Camera
from sphere_nav.geometry.files.untrusted import check_center, short, size, told_at
from sphere_nav.geometry.se3 import SE3


@dataclass(frozen=True, eq=False)
class ForeignRig:
    """Cameras with their poses `T_origin_camera`; the origin is the IMU if `is_by_imu`, else the first camera."""

    names: tuple[str, ...]
    cameras: tuple[Camera, ...]
    T_origin_camera: tuple[SE3, ...]
    is_by_imu: bool = False


def camera_at(where: str, size: tuple[int, int], plane: Sequence[float], model: Any, *more: Any) -> Camera:
    """Return a camera of one of our models, with what it has beyond its plane (fx, fy, cx, cy) in pixels.

    size: (width, height); where: the place in the file, for messages.
    """
    check_center((plane[2], plane[3]), size, where)
    with told_at(where):
        camera: Camera = model(*size, *plane, *more)
    return camera


def image_size(found: Any, where: str) -> tuple[int, int]:
    """Return [width, height]."""
    if not isinstance(found, list) or len(found) != 2:
        raise ValueError(f"{where}: expected [width, height], found {short(found)}")
    return size(found[0], where), size(found[1], where)


def refuse_model(found: Any, where: str, known: str) -> ValueError:
    """Return the refusal of a model that has no equal here, by its name."""
    return ValueError(f"{where}: expected {known}, found {short(found)}, which is not supported")
