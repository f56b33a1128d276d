"""Gradient features of visual and depth images (N17 section III-B), one by one and in stacks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mcl_depth.constants import FAR_M, LCN_SHARE, LCN_SHARE_OUTDOORS, MIN_CONTRAST_M, MIN_GRADIENT
from mcl_depth.likeness.depth_cache import Stack
from mcl_depth.likeness.kernels import NO_DIRECTION, NUM_DIRECTIONS
from mcl_depth.params import ComparisonParams

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class GradientFeatures:
    """Sobel gradients of one panorama; all arrays (H, W) float32, columns wrap around.

    x, y: unit direction of the gradient, (0, 0) where there is none or where the pixel is not seen.
    magnitude: its length; all of a panorama sum to 1. is_seen: which pixels may have one.
    """

    x: Image
    y: Image
    magnitude: Image
    is_seen: Mask


def visual_features(gray: Image, is_seen: Mask | bool = True) -> GradientFeatures:
    """Return the gradients of a level panorama (H, W) of grey levels, magnitudes summing to 1.

    Pixels outside `is_seen` (H, W), and those whose gradient would touch one, count nothing.
    """
    seen = np.isfinite(gray) & is_seen
    inner = _inner(seen)
    return GradientFeatures(*gradients_of(np.where(seen, gray, 0.0).astype(np.float32), inner), inner)


def depth_gradients(range_m: Image, params: ComparisonParams) -> tuple[Image, Image, Image]:
    """Return direction x, y and magnitude (H, W) of a range panorama (H, W) in m.

    `is_measured_only`: none where a pixel that it uses is unknown, and so are all around that one.
    """
    image = np.minimum(range_m, np.float32(FAR_M))
    if params.is_sky_far and not params.is_measured_only:  # what is unknown was not measured
        image[is_sky(range_m)] = FAR_M
    measured = _inner(~_inner(np.isnan(image))) if params.is_measured_only else np.ones(image.shape, np.bool_)
    share = LCN_SHARE_OUTDOORS if params.is_sky_far else LCN_SHARE
    radius = max(round(share * image.shape[1]), 1)
    return gradients_of(normalize_contrast(fill_unknown(image), radius, MIN_CONTRAST_M), measured)


def code_gradients(x: Image, y: Image, magnitudes: Image) -> Stack:
    """Return gradients (M, H, W) of panoramas, unit directions x, y and magnitudes, in two bytes a pixel.

    directions (M, H, W) uint8: angle of the gradient modulo pi in steps of pi / 255; 255 where there is none.
    magnitudes (M, H, W) uint8: scale * (byte / 255)^2. scale (M,) float32.
    Directions are within 0.36 degrees, magnitudes within 1 % of the largest.
    """
    angles = np.rint(np.arctan2(y, x) * np.float32(NUM_DIRECTIONS / np.pi)).astype(np.int64) % NUM_DIRECTIONS
    scale = magnitudes.max(axis=(1, 2))
    roots = np.sqrt(magnitudes / np.maximum(scale, np.float32(1e-30))[:, None, None])
    directions = np.where((x == 0) & (y == 0), NO_DIRECTION, angles).astype(np.uint8)
    return {"directions": directions, "magnitudes": np.rint(255.0 * roots).astype(np.uint8), "scale": scale}


def gradients_of(image: Image, counted: Mask) -> tuple[Image, Image, Image]:
    """Return the gradients (H, W) of an image: unit directions x, y, and magnitudes of sum 1; 0 if not counted."""
    x, y = (
        cv2.Sobel(_around(image, 1), cv2.CV_32F, *axis, borderType=cv2.BORDER_REPLICATE)[:, 1:-1]
        for axis in ((1, 0), (0, 1))
    )
    length = np.sqrt(x * x + y * y)
    length[~(counted & (length > MIN_GRADIENT))] = 0.0
    inverse = np.divide(1.0, length, out=np.zeros_like(length), where=length > 0.0)
    total = max(float(length.sum(dtype=np.float64)), 1e-30)
    return x * inverse, y * inverse, length * np.float32(1.0 / total)


def normalize_contrast(image: Image, radius: int, min_sigma: float) -> Image:
    """Return (D - m) / sigma of every pixel's (2 radius + 1)^2 neighbourhood (eq. 1); image (H, W) without NaN."""
    side, inside = (2 * radius + 1,) * 2, (slice(None), slice(radius, -radius))
    wide, plain = _around(image, radius), {"normalize": False, "borderType": cv2.BORDER_CONSTANT}
    rows = np.arange(len(image))[:, None]
    number = side[1] * (np.minimum(rows + radius + 1, len(image)) - np.maximum(rows - radius, 0))
    mean = cv2.boxFilter(wide, cv2.CV_64F, side, **plain)[inside] / number
    square = cv2.sqrBoxFilter(wide, cv2.CV_64F, side, **plain)[inside] / number
    sigma = np.sqrt(np.maximum(square - mean * mean, 0.0))
    return ((image - mean) / np.maximum(sigma, min_sigma)).astype(np.float32)


def fill_unknown(image: Image) -> Image:
    """Return an image (H, W) with NaN replaced by the mean of known pixels around it (alg. 1); 0 without any."""
    known = np.isfinite(image)
    if known.all() or not known.any():
        return np.nan_to_num(image)
    height, width = image.shape
    rows, filled, radius = np.arange(height), image, 1
    sums = [cv2.integral(np.tile(plane.astype(np.float32), 3)) for plane in (np.where(known, image, 0.0), known)]
    while np.isnan(filled).any():  # of boxes of radius 2^n, the smallest that knows any
        left = width - min(radius, width // 2)
        right = left + min(2 * radius + 1, width)
        bands = [J[np.minimum(rows + radius + 1, height)] - J[np.maximum(rows - radius, 0)] for J in sums]
        total, number = (band[:, right : right + width] - band[:, left : left + width] for band in bands)
        means = np.divide(total, number, out=np.full(image.shape, np.nan), where=number > 0.5)
        filled = np.where(np.isnan(filled), means.astype(np.float32), filled)
        radius *= 2
    return filled


def is_sky(range_m: Image) -> Mask:
    """Return which pixels (H, W) are unknown with all above them."""
    return np.isnan(np.fmax.accumulate(range_m, axis=0))


def _inner(mask: Mask) -> Mask:
    """Return which pixels (H, W) have all 3 x 3 around them in mask (H, W); what is above and below counts."""
    return cv2.erode(_around(mask.astype(np.uint8), 1), np.ones((3, 3), np.uint8))[:, 1:-1] > 0


def _around(image: NDArray[Any], margin: int) -> NDArray[Any]:
    """Return an image with so many columns more on each side, which wrap around."""
    return cv2.copyMakeBorder(image, 0, 0, margin, margin, cv2.BORDER_WRAP)
