"""Images and cameras from fine to coarse (M15 section 2.4), as kernels take them, and the cone that a camera sees."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import Camera
from sphere_nav.geometry.cameras.pinhole import PlaneCamera
from sphere_nav.geometry.cameras.spherical import level_cameras
from sphere_nav.photometric.align.iteration.kernels import FISHEYE, NUM_COEFFICIENTS, PLANE, SIDE, SPHERICAL
from sphere_nav.photometric.constants import CONE_GRID, CONE_MARGIN, MIN_LEVELS, SHARPER_LEVELS
from sphere_nav.photometric.params import PyramidParams
from sphere_nav.photometric.pixels import kernels

Floats = NDArray[np.float32]
KernelCamera: TypeAlias = tuple[int, Floats, Floats]

MODELS = {
    "pinhole": PLANE,
    "double_sphere": PLANE,
    "omni": PLANE,
    "fisheye": FISHEYE,
    "spherical": SPHERICAL,
}
EVERYWHERE = np.array([0.0, 0.0, 1.0, np.pi], np.float32)


@lru_cache(maxsize=64)
def kernel_camera(camera: Camera) -> KernelCamera:
    """Return model number, coefficients (17,) and shutter (8,), a global one, float32, as the kernels take them."""
    coefficients = np.zeros(NUM_COEFFICIENTS, np.float32)
    coefficients[: camera.coefficients.size] = camera.coefficients
    return MODELS[camera.model], coefficients, np.zeros(8, np.float32)


def rolling(camera: Camera, twist: NDArray[np.float64]) -> KernelCamera:
    """Return the camera for kernels with the motion (6,) (v, omega) within its readout (cameras/rolling_shutter.py)."""
    model, coefficients, _ = kernel_camera(camera)
    return model, coefficients, np.array([*twist, 0.5 * (camera.height - 1), camera.height], np.float32)


@lru_cache(maxsize=64)
def view_cone(camera: Camera) -> Floats:
    """Return the cone that holds all rays of a camera: axis (3,) and half angle in radians, together (4,) float32."""
    if camera.is_whole:
        return EVERYWHERE
    u, v = np.linspace(-0.5, camera.width - 0.5, CONE_GRID), np.linspace(-0.5, camera.height - 0.5, CONE_GRID)
    rays = camera.unproject(np.stack(np.meshgrid(u, v), axis=-1)).reshape(-1, 3)
    rays = rays[~np.isnan(rays[:, 0])]
    axis = rays.sum(axis=0)
    length = np.linalg.norm(axis)
    if not length > 0.1 * len(rays):  # all around, or nothing
        return EVERYWHERE
    angle = np.arccos(np.clip(np.min(rays @ (axis / length)), -1.0, 1.0)) + CONE_MARGIN
    return np.array([*(axis / length), min(angle, np.pi)], np.float32)


def in_blocks(pixels: Floats) -> Floats:
    """Return blocks of pixels (7, N), point, grey level and gradient, filled up with points that no camera sees."""
    rows, number = pixels.shape
    blocks = np.zeros((rows, -(-number // SIDE) * SIDE), np.float32)
    blocks[:, :number], blocks[:3, number:] = pixels, np.nan
    return np.ascontiguousarray(blocks.reshape(rows, -1, SIDE).swapaxes(0, 1)).reshape(-1)


def kernel_motion(matrix: NDArray[np.float64]) -> Floats:
    """Return the upper rows (3, 4) float32 of a rigid motion, as kernels take it."""
    return np.ascontiguousarray(matrix[:3], dtype=np.float32)


Image = NDArray[Any]
LINES: dict[type, Any] = {np.uint8: np.uint16, np.uint16: np.uint32, np.float32: np.float32}  # hold eight of them
NO_BYTES, NO_FLOATS = np.array([], np.uint8), np.array([], np.float32)


class Samples(NamedTuple):
    """An image as kernels load it: flat, bytes or floats, the other empty; width with the padding."""

    bytes: NDArray[np.uint8]
    floats: NDArray[np.float32]
    width: int
    height: int
    pad: int


@dataclass(frozen=True)
class Level:
    """One image of a pyramid. A whole sphere carries `pad` columns of its other edge on both sides."""

    image: Image
    camera: Camera
    pad: int

    @property
    def unpadded(self) -> Image:
        """The image without its padding."""
        return self.image[:, self.pad : self.pad + self.camera.width]

    @cached_property
    def samples(self) -> Samples:
        """The image as kernels take it."""
        flat, (height, width) = self.image.reshape(-1), self.image.shape
        if flat.dtype == np.uint8:
            return Samples(flat, NO_FLOATS, width, height, self.pad)
        return Samples(NO_BYTES, flat, width, height, self.pad)

    @property
    def kernel_camera(self) -> KernelCamera:
        """The camera as kernels take it."""
        return kernel_camera(self.camera)


@dataclass(frozen=True, eq=False)
class Pyramid:
    """Levels from full size to coarsest; of one with hidden cells `whole` is what it was before."""

    levels: tuple[Level, ...]
    whole: Pyramid | None = None

    @property
    def images(self) -> tuple[Image, ...]:
        """The images without their padding."""
        return tuple(level.unpadded for level in self.levels)

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The camera of each level."""
        return tuple(level.camera for level in self.levels)


def build_pyramid(
    image: Image, camera: Camera, params: PyramidParams | None = None, is_seen: NDArray[np.bool_] | None = None
) -> Pyramid:
    """Build the pyramid of a grey image (H, W), uint8 or float32; ValueError if it is not the camera's size.

    Where not all of it `is_seen` (H, W), the rest is NaN on all levels, and nothing is compared with it.

    Level 0 is the image itself, copied only if it is read-only: kernels would be compiled once more for such arrays.
    The coarser ones are float32.
    """
    params = params or PyramidParams()
    check_image(image, camera)
    if is_seen is not None and not is_seen.all():
        image = np.where(is_seen, image, np.float32(np.nan)).astype(np.float32, copy=False)
    cameras = level_cameras(camera, params.min_side, params.num_levels)
    pad = pad_of(camera)
    levels = [Level(_pad(np.require(image, requirements=["C", "W"]), pad), camera, pad)]
    for smaller in cameras[1:]:
        out = np.empty((smaller.height, smaller.width + 2 * pad), np.float32)
        levels.append(Level(halve(levels[-1].image, pad, out), smaller, pad))
    return Pyramid(tuple(levels))


def hide(pyramid: Pyramid, is_hidden: NDArray[np.bool_]) -> Pyramid:
    """Return a pyramid with NaN in some cells (rows, columns) of its image and half a cell around: nothing is compared.

    What hides a cell ends somewhere in the next one, and its edge goes with the camera.
    """
    is_hidden = cv2.dilate(np.kron(is_hidden, np.ones((2, 2), np.uint8)).astype(np.uint8), np.ones((3, 3))) > 0
    rows, columns = is_hidden.shape
    levels = []
    for level in pyramid.levels:
        height, width = level.camera.height, level.camera.width
        cell = np.ix_(np.arange(height) * rows // height, np.arange(width) * columns // width)
        image = np.where(is_hidden[cell], np.float32(np.nan), level.unpadded).astype(np.float32, copy=False)
        levels.append(Level(_pad(image, level.pad), level.camera, level.pad))
    return Pyramid(tuple(levels), pyramid)


def magnify(pyramid: Pyramid, factor: float) -> Pyramid:
    """Return a pyramid whose lens magnifies its image about the centre; a sphere has none."""
    levels = []
    for level in pyramid.levels:
        camera = level.camera
        levels.append(replace(level, camera=camera.scaled(factor)) if isinstance(camera, PlaneCamera) else level)
    return Pyramid(tuple(levels))


def match_sharpness(pyramid: Pyramid, pixels_per_radian: float) -> Pyramid:
    """Leave out the levels that are sharper than what they are compared with can show.

    Compared pixel by pixel, a sharp image resembles a blurred one little.
    """
    levels = pyramid.levels
    finest = math.floor(math.log2(levels[0].camera.pixels_per_radian / pixels_per_radian) + SHARPER_LEVELS)
    return Pyramid(levels[min(max(finest, 0), max(len(levels) - MIN_LEVELS, 0)) :])


def check_image(image: Image, camera: Camera) -> None:
    """Raise ValueError unless the image is grey, uint8 or float32, and of the camera's size."""
    if image.shape != (camera.height, camera.width):
        raise ValueError(f"image: expected {camera.width} x {camera.height} grey, found shape {image.shape}")
    if image.dtype not in (np.uint8, np.float32):
        raise ValueError(f"image: expected uint8 or float32, found {image.dtype}")
    if image.dtype == np.float32 and not np.isfinite(image.sum()):
        raise ValueError("image: expected finite grey levels, found NaN or Inf")


def pad_of(camera: Camera) -> int:
    """Return how many columns of its other edge an image carries on both sides: one where it closes, else none."""
    return int(camera.is_whole)


def _pad(image: Image, pad: int) -> Image:
    return np.concatenate([image[:, -pad:], image, image[:, :pad]], axis=1) if pad else image


def halve(image: Image, pad: int, out: Image) -> Image:
    """Write the next level of an image, both with `pad` columns of the other edge, and return it."""
    rounding = np.float32(0.0 if out.dtype == np.float32 else 0.5)
    kernels.halve(image, pad, np.array([1, 3], LINES[image.dtype.type]), rounding, out)
    return out
