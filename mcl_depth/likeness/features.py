"""Gradient features of visual and depth images (N17 section III-B), one by one and in stacks."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from mcl_depth.constants import FAR_M, LCN_SHARE, LCN_SHARE_OUTDOORS, MIN_CONTRAST_M
from mcl_depth.likeness import kernels
from mcl_depth.params import ComparisonParams

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class GradientFeatures:
    """Sobel gradients of one panorama; all arrays (H, W) float32, columns wrap around.

    x, y: unit direction of the gradient, (0, 0) where there is none or where the pixel is not seen.
    magnitude: its length; all of a panorama sum to 1. is_seen: None where every pixel is seen.
    """

    x: Image
    y: Image
    magnitude: Image
    is_seen: Mask | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W)."""
        return self.magnitude.shape[0], self.magnitude.shape[1]

    @property
    def identity(self) -> bytes:
        """What tells the image from others."""
        return self.magnitude.tobytes()

    @property
    def mirrored(self) -> GradientFeatures:
        """Those of the image whose left is right, ahead staying ahead."""
        x, y, magnitude = (np.ascontiguousarray(image[:, ::-1]) for image in (-self.x, self.y, self.magnitude))
        is_seen = None if self.is_seen is None else np.ascontiguousarray(self.is_seen[:, ::-1])
        return GradientFeatures(x, y, magnitude, is_seen)


@dataclass(frozen=True)
class Stack:
    """Depth features of M panoramas: arrays with a row for each."""

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Return the names of the arrays."""
        return tuple(item.name for item in fields(cls))

    @property
    def arrays(self) -> tuple[NDArray[Any], ...]:
        """The arrays in the order of their names."""
        return tuple(getattr(self, name) for name in self.names())

    def __len__(self) -> int:
        return len(self.arrays[0])

    @property
    def nbytes(self) -> int:
        """Memory of all panoramas in bytes."""
        return sum(array.nbytes for array in self.arrays)

    def take(self, indices: NDArray[np.integer] | slice) -> Self:
        """Return the panoramas of some indices."""
        return type(self)(*(array[indices] for array in self.arrays))

    def put(self, indices: NDArray[np.integer] | slice, other: Self) -> None:
        """Overwrite some panoramas by others."""
        for array, new in zip(self.arrays, other.arrays, strict=True):
            array[indices] = new


@dataclass(frozen=True)
class FeatureStack(Stack):
    """Depth features of M panoramas in two bytes a pixel.

    directions (M, H, W) uint8: angle of the gradient modulo pi in steps of pi / 255; 255 where there is none.
    magnitudes (M, H, W) uint8: scale * (byte / 255)^2. scales (M,) float32.
    Directions are within 0.36 degrees, magnitudes within 1 % of the largest.
    """

    directions: NDArray[np.uint8]
    magnitudes: NDArray[np.uint8]
    scales: NDArray[np.float32]

    @classmethod
    def empty(cls, capacity: int, height: int, width: int) -> Self:
        """Return room for `capacity` panoramas, to be filled by `put`."""
        shape = (capacity, height, width)
        return cls(np.empty(shape, np.uint8), np.empty(shape, np.uint8), np.empty(capacity, np.float32))


def visual_features(gray: Image, is_seen: Mask | None = None) -> GradientFeatures:
    """Return the gradients of a level panorama (H, W) of grey levels, magnitudes summing to 1.

    Pixels outside `is_seen` (H, W), and those whose gradient would touch one, count nothing.
    """
    gray = np.ascontiguousarray(gray, np.float32)
    seen = np.isfinite(gray) if is_seen is None else np.isfinite(gray) & is_seen
    x, y, magnitude, inner = kernels.visual_gradients(np.where(seen, gray, np.float32(0)), seen)
    return GradientFeatures(x, y, magnitude, None if inner.all() else inner)


def depth_features_many(ranges_m: Image, params: ComparisonParams) -> FeatureStack:
    """Return the features of range panoramas (M, H, W) in m; in parallel."""
    ranges_m = np.ascontiguousarray(ranges_m, np.float32)
    parts = kernels.encode_depth_many(ranges_m, *options_of(params, ranges_m.shape[2]))
    return FeatureStack(parts[0], parts[1], parts[2])


def options_of(params: ComparisonParams, width: int) -> tuple[bool, bool, float, int, float]:
    """Return what the kernels of depth images take, in their order."""
    share = LCN_SHARE_OUTDOORS if params.is_sky_far else LCN_SHARE
    is_sky_far = params.is_sky_far and not params.is_measured_only  # what is unknown was not measured
    return is_sky_far, params.is_measured_only, FAR_M, max(round(share * width), 1), MIN_CONTRAST_M
