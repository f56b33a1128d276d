"""Two cameras side by side -> a rectified pair: by their calibration, then by what their own images say about it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.constants import ERODED_PX, FAR_WORSE, MAX_TURN_DEG, MIN_BASELINE_M, NUM_INSTANTS
from sphere_mapping.acquisition.partial.depth_registration import pixels_of
from sphere_mapping.acquisition.stereo.stereo_field import (
    RowFit,
    StereoField,
    basis_of_rows,
    fit_rows,
    match_corners,
    tangents,
)
from sphere_nav.geometry import SE3, Camera, Pinhole
from sphere_nav.geometry.arrays import Array, Bytes, Flags
from sphere_nav.geometry.cameras.camera import pixel_grid
from sphere_nav.geometry.plausible import check_length
from sphere_nav.spheres.sphere import to_gray_bytes


@dataclass(frozen=True, eq=False)
class PairGeometry:
    """What a calibration says of a pair.

    left, right: lenses of the images as they come. R_rectified_left, R_rectified_right (3, 3): from their optical axes
    to those of the rectified pair, whose x points from the left centre to the right one. camera: of both rectified
    images.
    """

    left: Camera
    right: Camera
    R_rectified_left: Array
    R_rectified_right: Array
    camera: Pinhole
    baseline_m: float

    @property
    def is_rectified(self) -> bool:
        """Whether the images as they come are the rectified ones."""
        turns = np.stack([self.R_rectified_left, self.R_rectified_right])
        return np.allclose(turns, np.eye(3), atol=1e-9) and self.left == self.camera == self.right

    def as_rectified(self) -> PairGeometry:
        """Return what holds if the images have been rectified already."""
        return replace(
            self, left=self.camera, right=self.camera, R_rectified_left=np.eye(3), R_rectified_right=np.eye(3)
        )


def geometry_of(left: Camera, right: Camera, T_left_right: SE3) -> PairGeometry:
    """Return the rectification of two cameras by their poses: both turn by half, then towards the baseline.

    ValueError where the right camera is not beside the left one.
    """
    along = np.asarray(T_left_right.translation, np.float64)
    baseline_m = float(np.linalg.norm(along))
    if baseline_m < (least := MIN_BASELINE_M["stereo"]):
        raise ValueError(f"stereo: expected centres at least {least} m apart, found {baseline_m:.4f} m")
    check_length("baseline", baseline_m, "stereo: centres of both cameras apart")
    x = along / baseline_m
    ahead = np.array([0.0, 0.0, 1.0]) + T_left_right.rotation[:, 2]
    z = ahead - x * (x @ ahead)
    z = z / max(float(np.linalg.norm(z)), 1e-9)
    R_left = np.stack([x, np.cross(z, x), z])
    R_right = R_left @ T_left_right.rotation
    for name, turn in (("left", R_left), ("right", R_right)):
        angle = float(np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1.0, 1.0))))
        if angle > MAX_TURN_DEG:
            place = np.array2string(along, precision=3, suppress_small=True)
            raise ValueError(
                f"stereo: expected the right camera beside the left one, found it at {place} m, and the {name} one "
                f"turned by {angle:.0f} deg against the pair"
            )
    return PairGeometry(left, right, R_left, R_right, _common_camera(left, R_left), baseline_m)


def _common_camera(left: Camera, R_rectified_left: Array) -> Pinhole:
    """Return a pinhole camera as fine as the left one, of its size, that looks where it looks."""
    f = left.pixels_per_radian
    ahead = R_rectified_left @ np.array([0.0, 0.0, 1.0])
    cx, cy = (left.width - 1) / 2 - f * ahead[0] / ahead[2], (left.height - 1) / 2 - f * ahead[1] / ahead[2]
    return Pinhole(left.width, left.height, f, f, float(cx), float(cy))


@dataclass(eq=False)
class StereoPair:
    """Rectifies images by a geometry, and corrects the right one by a field: a given one, or that of the first rows.

    The rows of the first NUM_INSTANTS pairs are compared; each pair that comes makes the correction surer.
    """

    geometry: PairGeometry
    correction: StereoField | None = None  # None: found from the images
    fit: RowFit | None = None
    _matches: list[tuple[Array, Array]] = field(default_factory=list)
    _is_told: bool = False  # whether it is known that the images are as the geometry says

    def __post_init__(self) -> None:
        self._set_tables()

    @property
    def rows_px(self) -> float:
        """How far rows disagree before the correction: the worst of the inner nineteen in twenty, px."""
        if self.fit is None:
            return 0.0
        x, y = tangents(self.geometry.camera, pixel_grid(self.geometry.camera)[::8, ::8])
        return float(np.percentile(np.abs(basis_of_rows(x, y) @ self.fit.rows), 95))

    def rectify(self, left: Bytes, right: Bytes) -> tuple[Bytes, Bytes]:
        """Return both images (H, W[, 3]) of the rectified pair."""
        if self.correction is None and len(self._matches) < NUM_INSTANTS:
            self._learn(left, right)
        return self._warp(left, self._tables[0]), self._warp(right, self._tables[1])

    @property
    def is_seen(self) -> Flags | None:
        """Where (H, W) the rectified left image shows something, not too near to its border; None: everywhere."""
        if self._tables[0] is None:
            return None
        (u, v), lens = self._tables[0], self.geometry.left
        inside = (u >= 0) & (v >= 0) & (u <= lens.width - 1) & (v <= lens.height - 1)
        return cv2.erode(inside.astype(np.uint8), np.ones((2 * ERODED_PX + 1,) * 2, np.uint8)) > 0

    def _learn(self, left: Bytes, right: Bytes) -> None:
        if not self._is_told and not self.geometry.is_rectified:
            self.geometry = self._choose(left, right)
        self._is_told = True
        self._set_tables(StereoField())
        self._matches.append(self._match(left, right))
        first, second = (np.concatenate(parts) for parts in zip(*self._matches, strict=True))
        self.fit = fit_rows(self.geometry.camera, first, second)
        if self.fit is not None and self.fit.is_significant:
            self._set_tables(StereoField(rows=tuple(self.fit.rows)))

    def _choose(self, left: Bytes, right: Bytes) -> PairGeometry:
        """Return the geometry by which the rows agree: drivers tell the same of images that are rectified already."""
        fits = []
        for geometry in (self.geometry, self.geometry.as_rectified()):
            trial = StereoPair(geometry, StereoField())
            fits.append((geometry, fit_rows(geometry.camera, *trial._match(left, right))))
        (told, fit), (already, other) = fits
        is_already = other is not None and (fit is None or fit.before_px > FAR_WORSE * other.before_px)
        return already if is_already and left.shape[:2] == (already.camera.height, already.camera.width) else told

    def _match(self, left: Bytes, right: Bytes) -> tuple[Array, Array]:
        return match_corners(
            *(to_gray_bytes(self._warp(image, table)) for image, table in zip((left, right), self._tables, strict=True))
        )

    def _set_tables(self, correction: StereoField | None = None) -> None:
        g, applied = self.geometry, correction or self.correction or StereoField()
        is_ready = g.is_rectified
        left = None if is_ready else _table(g.left, g.R_rectified_left, g.camera, StereoField())
        is_ready = is_ready and applied.is_nothing
        right = None if is_ready else _table(g.right, g.R_rectified_right, g.camera, applied)
        self._tables = (left, right)

    def _warp(self, image: Bytes, table: tuple[NDArray, NDArray] | None) -> Bytes:
        return image if table is None else cv2.remap(image, *table, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)


def _table(lens: Camera, R_rectified_raw: Array, camera: Pinhole, applied: StereoField) -> tuple[NDArray, NDArray]:
    """Return the maps of cv2.remap from an image as it comes to the rectified and corrected one."""
    pixels = pixel_grid(camera)
    du, dv = applied.shift(*tangents(camera, pixels))
    rays = camera.unproject(pixels + np.stack([du, dv], axis=-1)) @ R_rectified_raw
    return pixels_of(rays, lens)[:2]
