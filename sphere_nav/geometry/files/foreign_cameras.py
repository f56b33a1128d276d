"""What readers of other programs' files share: cameras with poses, and lenses that are ours by another name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sphere_nav.geometry.cameras.camera import Camera
from sphere_nav.geometry.cameras.double_sphere import DoubleSphere
from sphere_nav.geometry.cameras.fisheye import Fisheye
from sphere_nav.geometry.cameras.omni import Omni
from sphere_nav.geometry.cameras.pinhole import Pinhole
from sphere_nav.geometry.files.untrusted import check_center, numbers, short, size, told_at
from sphere_nav.geometry.se3 import SE3


@dataclass(frozen=True, eq=False)
class ForeignRig:
    """Cameras with their poses `T_origin_camera`; the origin is the IMU if `is_by_imu`, else the first camera.

    topics: where files tell.
    """

    names: tuple[str, ...]
    cameras: tuple[Camera, ...]
    T_origin_camera: tuple[SE3, ...]
    is_by_imu: bool = False
    topics: tuple[str, ...] = ()


@dataclass(frozen=True)
class ForeignLens:
    """Focal lengths and centre in pixels, image size (width, height), and where in the file they stand."""

    size: tuple[int, int]
    fx: float
    fy: float
    cx: float
    cy: float
    where: str

    def pinhole(self, distortion: tuple[float, ...] = ()) -> Camera:
        """Return the camera with radial and tangential distortion k1 k2 p1 p2 [k3 [k4 k5 k6]]."""
        return self._check(Pinhole, distortion)

    def fisheye(self, distortion: tuple[float, ...]) -> Camera:
        """Return the camera of Kannala and Brandt."""
        return self._check(Fisheye, distortion)

    def double_sphere(self, xi: float, alpha: float) -> Camera:
        """Return the camera of Usenko, Demmel and Cremers; xi = 0: x / (alpha d + (1 - alpha) z)."""
        return self._check(DoubleSphere, xi, alpha)

    def omni(self, xi: float, distortion: tuple[float, ...] = ()) -> Camera:
        """Return Mei's camera, x / (z + xi d), with radial and tangential distortion behind it."""
        return self._check(Omni, xi, distortion)

    def _check(self, model: Any, *more: Any) -> Camera:
        check_center((self.cx, self.cy), self.size, self.where)
        with told_at(self.where):
            camera: Camera = model(*self.size, self.fx, self.fy, self.cx, self.cy, *more)
        return camera


def image_size(found: Any, where: str) -> tuple[int, int]:
    """Return [width, height]."""
    if not isinstance(found, list) or len(found) != 2:
        raise ValueError(f"{where}: expected [width, height], found {short(found)}")
    return size(found[0], where), size(found[1], where)


def vector(values: Mapping[str, Any], name: str, where: str, count: int) -> tuple[float, ...]:
    """Return a field of a camera that is a list of numbers; it may be left out where it may be empty."""
    return numbers(values.get(name) or [], f"{where}.{name}", count)


def refuse_model(found: Any, where: str, known: str) -> ValueError:
    """Return the refusal of a model that has no equal here, by its name."""
    return ValueError(f"{where}: expected {known}, found {short(found)}, which is not supported")
