"""The augmented sphere: what was seen in every direction from one place, with the range of each pixel (M15 eq. 9)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import Spherical
from sphere_nav.geometry.arrays import Bytes, Flags, Floats
from sphere_nav.geometry.cameras.camera import pixel_grid
from sphere_nav.geometry.cameras.rig import T_BODY_OPTICAL as T_BODY_OPTICAL

Gray = TypeVar("Gray", np.uint8, np.float32)

UNSEEN = 0  # grey level of a pixel that no camera saw; a pixel that was seen is at least 1

ROWS = 16  # that are turned grey at once: the colours in floats are large, and large blocks cost page faults


@dataclass(frozen=True, eq=False)
class Sphere:
    """An image and its range, in the sphere frame (body axes); a *partial sphere* is a window of the whole sphere.

    image: (H, W) grey or (H, W, 3) RGB, uint8; 0 where no camera saw.
    range_m: (H, W) float32, metres along the ray; NaN = not measured, +Inf = known to be far.
    range_std_m: (H, W) float32, standard deviation of the range in metres, where the sensor offers one.
    """

    image: Bytes
    range_m: Floats
    camera: Spherical
    stamp_ns: int = 0
    range_std_m: Floats | None = None

    def __post_init__(self) -> None:
        check_sphere_image(self.image, self.camera, "sphere image")
        _check_plane(self.range_m, self.camera, "sphere range")
        if self.range_std_m is not None:
            _check_plane(self.range_std_m, self.camera, "sphere range std")
        if not isinstance(self.stamp_ns, int):
            raise ValueError(f"sphere stamp: expected integer nanoseconds, found {self.stamp_ns!r}")

    @cached_property
    def gray(self) -> Floats:
        """Grey levels 0...255 (H, W); unseen pixels continue the nearest seen one, so that no edge shows there."""
        gray = to_gray(self.image)
        return continued(gray, (gray > UNSEEN) | ~np.isnan(self.range_m))

    @property
    def levels(self) -> Bytes | Floats:
        """The same, as bytes where the image is grey."""
        if self.image.ndim == 3:
            return self.gray
        return self.image if self.image.min() > UNSEEN else continued(self.image, self.is_seen)

    @cached_property
    def is_seen(self) -> Flags:
        """Which pixels (H, W) a camera saw."""
        gray = self.image if self.image.ndim == 2 else to_gray(self.image)
        return (gray > UNSEEN) | ~np.isnan(self.range_m)

    @property
    def measured(self) -> Flags:
        """Which pixels (H, W) have a finite range."""
        return np.isfinite(self.range_m)

    def points(self, step: int = 1) -> tuple[Floats, Bytes]:
        """Return measured points (N, 3) in the sphere frame and their image values, each `step`-th row and column."""
        keep = self.measured[::step, ::step]
        rays = self.camera.unproject(pixel_grid(self.camera)[::step, ::step][keep])
        points = rays * self.range_m[::step, ::step][keep][:, None]
        return points.astype(np.float32), self.image[::step, ::step][keep]


def to_gray(image: NDArray[Any]) -> Floats:
    """Return the grey levels (H, W) of a grey or RGB image."""
    if image.ndim == 2:
        return image.astype(np.float32)
    gray = np.empty(image.shape[:2], np.float32)
    for row in range(0, len(image), ROWS):
        gray[row : row + ROWS] = cv2.cvtColor(image[row : row + ROWS].astype(np.float32), cv2.COLOR_RGB2GRAY)
    return gray


def to_gray_bytes(image: Bytes) -> Bytes:
    """Return the grey levels (H, W) of a grey or RGB image, rounded."""
    return cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.uint8, copy=False) if image.ndim == 3 else image


def to_rgb(image: Bytes) -> Bytes:
    """Return the colours (H, W, 3) of a grey or RGB image."""
    return image if image.ndim == 3 else np.repeat(image[..., None], 3, axis=2)


def continued(values: NDArray[Gray], is_known: Flags) -> NDArray[Gray]:
    """Return the values (H, W) with unknown pixels taken from the nearest known one."""
    if is_known.all() or not is_known.any():
        return values
    unknown = (~is_known).astype(np.uint8)
    _, label = cv2.distanceTransformWithLabels(unknown, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    known = np.zeros(int(label.max()) + 1, dtype=values.dtype)
    known[label[is_known]] = values[is_known]
    return known[label]


def check_sphere_image(image: NDArray[Any], camera: Any, name: str = "image") -> None:
    """Raise ValueError unless the image is uint8, grey or RGB, of the camera's size."""
    expected = f"{camera.width} x {camera.height} uint8, grey or RGB"
    is_gray_or_rgb = image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 3)
    if image.dtype != np.uint8 or not is_gray_or_rgb or image.shape[:2] != (camera.height, camera.width):
        raise ValueError(f"{name}: expected {expected}, found {_describe(image)}")


def check_depth(depth_m: NDArray[Any], camera: Any, name: str = "depth") -> None:
    """Raise ValueError unless the depth is a floating-point image in metres of the camera's size."""
    if not np.issubdtype(depth_m.dtype, np.floating) or depth_m.shape != (camera.height, camera.width):
        raise ValueError(f"{name}: expected {camera.width} x {camera.height} metres, found {_describe(depth_m)}")


def _check_plane(values: NDArray[Any], camera: Spherical, name: str) -> None:
    if values.dtype != np.float32 or values.shape != (camera.height, camera.width):
        raise ValueError(f"{name}: expected {camera.width} x {camera.height} float32, found {_describe(values)}")
    smallest = np.fmin.reduce(values, axis=None)
    if smallest <= 0:
        raise ValueError(f"{name}: expected positive metres, NaN or +Inf, found {smallest}")


def _describe(values: NDArray[Any]) -> str:
    sides = " x ".join(str(side) for side in (*values.shape[1::-1], *values.shape[2:]))
    return f"{sides or 'a scalar'} {values.dtype}"
