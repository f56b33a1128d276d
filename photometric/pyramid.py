"""Images and cameras from fine to coarse (M15 section 2.4)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photometric import kernels
from photometric.params import PyramidParams
from sphere_geometry import Camera, Spherical

Image = NDArray[Any]


@dataclass(frozen=True)
class Level:
    """One image of a pyramid. A whole sphere carries `pad` columns of its other edge on both sides."""

    image: Image
    camera: Camera
    pad: int


@dataclass(frozen=True)
class Pyramid:
    """Levels from full size to coarsest."""

    levels: tuple[Level, ...]

    @property
    def images(self) -> tuple[Image, ...]:
        """The images without their padding."""
        return tuple(level.image[:, level.pad : level.image.shape[1] - level.pad] for level in self.levels)

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The camera of each level."""
        return tuple(level.camera for level in self.levels)


def build_pyramid(image: Image, camera: Camera, params: PyramidParams | None = None) -> Pyramid:
    """Build the pyramid of a grey image (H, W), uint8 or float32; ValueError if it is not the camera's size.

    Level 0 is the image itself, copied only if it is read-only: kernels are compiled once more for such arrays. The
    coarser ones are float32.
    """
    params = params or PyramidParams()
    check_image(image, camera)
    is_whole = isinstance(camera, Spherical) and camera.is_whole
    levels = [_level(np.require(image, requirements=["C", "W"]), camera, is_whole)]
    while len(levels) < params.num_levels and _can_halve(levels[-1].camera, params.min_side):
        previous = levels[-1]
        levels.append(_level(_halve(previous), previous.camera.halved(), is_whole))
    return Pyramid(tuple(levels))


def check_image(image: Image, camera: Camera) -> None:
    """Raise ValueError unless the image is grey, uint8 or float32, and of the camera's size."""
    if image.shape != (camera.height, camera.width):
        raise ValueError(f"image: expected {camera.width} x {camera.height} grey, found shape {image.shape}")
    if image.dtype not in (np.uint8, np.float32):
        raise ValueError(f"image: expected uint8 or float32, found {image.dtype}")
    if image.dtype == np.float32 and not np.isfinite(image.sum()):
        raise ValueError("image: expected finite grey levels, found NaN or Inf")


def _can_halve(camera: Camera, min_side: int) -> bool:
    if isinstance(camera, Spherical) and camera.is_whole and (camera.width % 4 or camera.height % 2):
        return False
    return min(camera.width, camera.height) // 2 >= min_side


def _level(image: Image, camera: Camera, is_whole: bool) -> Level:
    if not is_whole:
        return Level(image, camera, 0)
    return Level(np.concatenate([image[:, -1:], image, image[:, :1]], axis=1), camera, 1)


def _halve(level: Level) -> Image:
    image = level.image
    if level.pad:  # the kernel reaches one column beyond both ends: halve two more, cut them off again
        image = np.concatenate([image[:, -3:-2], image, image[:, 2:3]], axis=1)
    out = np.empty((image.shape[0] // 2, image.shape[1] // 2), np.float32)
    kernels.halve(image, out)
    return np.ascontiguousarray(out[:, level.pad : out.shape[1] - level.pad])
