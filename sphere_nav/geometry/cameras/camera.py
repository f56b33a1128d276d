"""What every camera model offers. One file per model; nothing asks which model it has."""

from __future__ import annotations

from typing import ClassVar, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike

from sphere_nav.geometry.arrays import Array, Flags

MAX_SIDE = 1 << 16  # px
MAX_PIXELS = 1 << 26


class Camera(Protocol):
    """A central camera: pixels (u, v) to rays and back. Pixel centres are integers, arrays are [v, u]."""

    model: ClassVar[str]

    @property
    def is_whole(self) -> bool:
        """Whether it sees in every direction, so that its columns wrap around."""
        ...

    def __hash__(self) -> int:
        """Cameras are values: equal ones hash alike, so that tables made for one can be kept."""
        ...

    @property
    def width(self) -> int:
        """Columns of the image."""
        ...

    @property
    def height(self) -> int:
        """Rows of the image."""
        ...

    @property
    def coefficients(self) -> Array:
        """All numbers of the projection in the order that the kernels of this model expect."""
        ...

    @property
    def pixels_per_radian(self) -> float:
        """Angular resolution on the optical axis, or on the equator of a sphere."""
        ...

    def project(self, points: ArrayLike) -> tuple[Array, Flags]:
        """Project points (..., 3) in the camera frame to pixels (..., 2) and whether each is inside the image."""
        ...

    def unproject(self, pixels: ArrayLike) -> Array:
        """Return unit rays (..., 3) of pixels (..., 2); NaN where the model has no ray."""
        ...

    def J_project(self, points: ArrayLike) -> Array:
        """Return the derivative (..., 2, 3) of the pixel by the point, in pixels per metre."""
        ...

    def halve(self) -> Self:
        """Return the camera of the next pyramid level, whose pixel (u, v) covers 2 x 2 pixels of this one."""
        ...


def pixel_grid(camera: Camera) -> Array:
    """Return the pixel coordinates (height, width, 2) as (u, v) of every pixel."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    return np.stack([u, v], axis=-1).astype(np.float64)


def pixel_rays(camera: Camera) -> Array:
    """Return the unit rays (height, width, 3) of every pixel; NaN where the model has no ray."""
    return camera.unproject(pixel_grid(camera))


def inside(pixels: Array, camera: Camera) -> Flags:
    """Return which pixels (..., 2) lie on the area of the image, half a pixel beyond its outer centres included."""
    u, v = pixels[..., 0], pixels[..., 1]
    return (u >= -0.5) & (u < camera.width - 0.5) & (v >= -0.5) & (v < camera.height - 0.5)


def check_size(width: int, height: int) -> None:
    """Raise ValueError unless the image has at least one pixel, and no more than memory holds."""
    if not (1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE and width * height <= MAX_PIXELS):
        limits = f"at least 1 x 1, sides up to {MAX_SIDE}, {MAX_PIXELS} pixels in all"
        raise ValueError(f"camera size: expected {limits}, found {width} x {height}")
