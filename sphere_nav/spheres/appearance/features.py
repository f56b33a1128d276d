"""Local features of a sphere or of any camera's image: where they look to, how far it is there, what is seen there.

SIFT by OpenCV. A whole sphere is continued across its seam before, so that no feature is lost or cut there; its poles,
where the picture is stretched beyond use, are left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import Camera
from sphere_nav.geometry.arrays import Bytes, Flags, Floats
from sphere_nav.spheres.constants import (
    CONTRAST,
    FEATURE_SEAM,
    FINE_FACTOR,
    MAX_ELEVATION,
    MAX_FEATURES,
    MAX_PARTIAL,
    MAX_WHOLE,
    MIN_FEATURE_SIDE,
)
from sphere_nav.spheres.sphere import Sphere

SIZE = 128  # numbers of a descriptor
SCALE = 500.0  # of a descriptor's square roots, which are 0...1 and rarely above a half, as bytes


@dataclass(frozen=True, eq=False)
class Features:
    """N features of one image.

    rays: (N, 3) unit vectors in the frame of the camera; of a sphere, body axes.
    range_m: (N,) metres along the ray, NaN where not known.
    descriptors: (N, 128) uint8, square roots of SIFT's (Arandjelovic and Zisserman 2012) by `SCALE`.
    """

    rays: Floats
    range_m: Floats
    descriptors: Bytes

    def __post_init__(self) -> None:
        number = len(self.rays)
        shapes = self.rays.shape, self.range_m.shape, self.descriptors.shape
        if shapes != ((number, 3), (number,), (number, SIZE)):
            raise ValueError(f"features: expected (N, 3), (N,) and (N, {SIZE}), found {shapes}")

    def __len__(self) -> int:
        return len(self.rays)

    @property
    def points(self) -> Floats:
        """Points (N, 3) m in the frame of the camera, NaN where the range is not known."""
        return self.rays * self.range_m[:, None]

    def unit_descriptors(self) -> Floats:
        """Return the descriptors (N, 128) as unit vectors: their products are cosines."""
        values = self.descriptors.astype(np.float32)
        return values / np.maximum(np.linalg.norm(values, axis=1, keepdims=True), 1.0)


def features_of_sphere(sphere: Sphere, *, is_fine: bool = False) -> Features:
    """Return the features of an augmented sphere, whole or partial, with their ranges; `is_fine` as of an image."""
    return features_of_image(sphere.gray, sphere.camera, sphere.range_m, sphere.is_seen, is_fine=is_fine)


def features_of_image(
    gray: NDArray[Any],
    camera: Camera,
    range_m: Floats | None = None,
    is_seen: Flags | None = None,
    max_features: int = MAX_FEATURES,
    *,
    is_fine: bool = False,
) -> Features:
    """Return the strongest features of a grey image (H, W); `range_m` (H, W) in metres, `is_seen` what shows.

    `is_fine`: those that are seen again from nearby, more of them and more exact, but not from metres apart.
    """
    shrink = _shrink(camera, is_fine=is_fine)
    size = camera.width // shrink, camera.height // shrink
    image = np.clip(np.rint(cv2.resize(gray, size, interpolation=cv2.INTER_AREA)), 0, 255).astype(np.uint8)
    scale = np.array([camera.width, camera.height]) / size
    pad = FEATURE_SEAM if camera.is_whole else 0
    if pad:
        image = np.ascontiguousarray(np.hstack([image[:, -pad:], image, image[:, :pad]]))
    found, raw = cv2.SIFT_create(contrastThreshold=CONTRAST).detectAndCompute(image, None)
    if raw is None:
        return Features(np.zeros((0, 3), np.float32), np.zeros(0, np.float32), np.zeros((0, SIZE), np.uint8))
    pixels = np.array([point.pt for point in found])
    pixels[:, 0] -= pad
    pixels = (pixels + 0.5) * scale - 0.5  # pixel centres are integers on every scale
    rays = camera.unproject(pixels)
    column, row = np.rint(pixels).astype(np.int64).T
    is_usable = (column >= 0) & (column < camera.width) & ~np.isnan(rays[:, 0])  # SIFT finds none at a border
    if pad:
        is_usable &= np.abs(rays[:, 2]) < np.sin(MAX_ELEVATION)
    if is_seen is not None:
        is_usable[is_usable] = is_seen[row[is_usable], column[is_usable]]
    strength = np.array([point.response for point in found])
    kept = np.flatnonzero(is_usable)
    kept = kept[np.argsort(-strength[kept], kind="stable")[:max_features]]
    known = np.full(len(kept), np.nan, np.float32) if range_m is None else range_m[row[kept], column[kept]]
    known = np.where(np.isfinite(known), known, np.float32(np.nan))
    return Features(rays[kept].astype(np.float32), known.astype(np.float32), _roots(raw[kept]))


def _shrink(camera: Camera, *, is_fine: bool = False) -> int:
    """Return the whole factor by which an image is made smaller: what is seen from metres apart is not finer."""
    limit = (MAX_WHOLE if camera.is_whole else MAX_PARTIAL) * (FINE_FACTOR if is_fine else 1.0)
    factor = 1
    while (
        camera.pixels_per_radian / factor > limit
        and min(camera.width, camera.height) // (2 * factor) >= MIN_FEATURE_SIDE
    ):
        factor *= 2
    return factor


def _roots(raw: Floats) -> Bytes:
    total = np.maximum(raw.sum(axis=1, keepdims=True), 1e-6)
    return np.clip(np.rint(SCALE * np.sqrt(raw / total)), 0, 255).astype(np.uint8)
