"""Which pixel of which camera a pixel of the sphere is, computed once for every set of cameras that deliver.

Each direction belongs to the camera that sees it farthest from its border. A camera is drawn there, and where strips
mix it with others: in *tiles*, rectangles of the sphere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.constants import MAX_HALF_TANGENT, TABLE_SIDE, VERY_FAR_M
from sphere_mapping.acquisition.kernels import warp_by_range
from sphere_mapping.acquisition.stitching.strips import OUTSIDE, Block, Strip, strips_of, tiles_of
from sphere_nav.geometry import SE3, Camera, Rig, RigCamera, Spherical
from sphere_nav.geometry.arrays import Array, Bytes, Flags, Floats
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.geometry.files.encoded import read_image_file
from sphere_nav.spheres.sphere import continued

Lens = tuple[Floats, Floats, Floats, Floats]  # R (3, 3), b (3,), extent (2,), table (S, S, 3) of u, v and border


@dataclass(frozen=True, eq=False)
class RigView:
    """A camera as it seen from the centre of a sphere: its model, its pose, how far each pixel is from the border.

    border: (h, w) float32, angle in radians from a pixel to the nearest one without use (image border, mask, no ray).
    """

    name: str
    camera: Camera
    T_sphere_camera: SE3
    border: Floats

    def project(self, points: Array) -> tuple[Floats, Floats, Floats]:
        """Return u, v and border (...,) where the camera sees points (..., 3) of the sphere's frame; 0: not at all."""
        return self.look(self.T_sphere_camera.inverse().apply(points))

    def look(self, points: Array) -> tuple[Floats, Floats, Floats]:
        """Return the same of points (..., 3) in the frame of the camera."""
        pixels, visible = self.camera.project(points)
        u, v = (np.nan_to_num(pixels[..., k], nan=-1e4, posinf=-1e4, neginf=-1e4).astype(np.float32) for k in (0, 1))
        flat = [np.ascontiguousarray(plane.reshape(len(points), -1)) for plane in (u, v)]
        border = cv2.remap(self.border, *flat, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).reshape(u.shape)
        return u, v, np.where(visible, np.maximum(border, 0.0), np.float32(0.0))

    @cached_property
    def lens(self) -> Lens:
        """The lens as `kernels.warp_by_range` takes it, but for its table (S S, 3): u, v and border.

        A camera model is asked for pixels when this is made and never again, so that every central camera will do.
        """
        rays = pixel_rays(self.camera)[self.border > 0]
        largest = np.sqrt(np.max((1 - rays[:, 2]) / np.maximum(1 + rays[:, 2], 1e-3), initial=1e-3))
        largest = min(1.05 * float(largest), MAX_HALF_TANGENT)
        s, t = np.meshgrid(*[np.linspace(-largest, largest, TABLE_SIDE)] * 2)
        extent = np.array([largest, (TABLE_SIDE - 1) / (2 * largest)], np.float32)
        R = self.T_sphere_camera.rotation.T
        table = np.stack(self.look(np.stack([2 * s, 2 * t, 1 - (s * s + t * t)], axis=-1)), axis=-1)
        return R.astype(np.float32), (R @ self.T_sphere_camera.translation).astype(np.float32), extent, table


@dataclass(frozen=True, eq=False)
class StitchedView:
    """One camera's part in a sphere: which pixels it alone shows, and in which rectangles it is needed at all.

    lens: of `warp_by_range`: beyond what the camera sees the nearest that it does. is_owned: (H, W), not 0 where the
    sphere shows this camera. tables: fixed-point maps of cv2.remap for each of the tiles, at the common distance.
    """

    rig_view: RigView
    lens: Lens
    is_owned: Bytes
    tiles: tuple[Block, ...]
    tables: tuple[tuple[NDArray, NDArray], ...]


@dataclass(frozen=True, eq=False)
class Layout:
    """All views of a sphere; owner (H, W) int8 says which view shows a pixel, -1 none; strips are where views mix."""

    whole: Spherical
    views: tuple[StitchedView, ...]
    owner: NDArray[np.int8]
    strips: tuple[Strip, ...]

    @property
    def is_covered(self) -> Flags:
        """Which pixels (H, W) some camera sees."""
        return self.owner != OUTSIDE

    @property
    def centers(self) -> Floats:
        """Centres of the cameras (N, 3) in the frame of the sphere."""
        centers = [view.rig_view.T_sphere_camera.translation for view in self.views]
        return np.array(centers, dtype=np.float32).reshape(-1, 3)


def masks_of(rig: Rig) -> dict[str, Bytes]:
    """Read the masks of a rig's cameras; ValueError for a file that is no image."""
    return {
        part.name: read_image_file(part.mask, cv2.IMREAD_GRAYSCALE, f"mask of {part.name}").astype(np.uint8)
        for part in rig.cameras
        if part.mask is not None
    }


def border_of(part: RigCamera, mask: Bytes | None) -> Floats:
    """Return the angle (h, w) in radians from each pixel of a camera to the nearest one without use."""
    usable = np.isfinite(pixel_rays(part.camera)).all(axis=-1)
    if mask is not None:
        if mask.shape[:2] != usable.shape:
            size = f"{part.camera.width} x {part.camera.height}"
            raise ValueError(f"{part.name}: mask: expected {size}, found {mask.shape[1]} x {mask.shape[0]}")
        usable &= (mask if mask.ndim == 2 else mask.max(axis=2)) > 0
    padded = np.pad(usable, 1).astype(np.uint8)
    distance = cv2.distanceTransform(padded, cv2.DIST_L2, 5)[1:-1, 1:-1]
    return np.maximum(distance - 0.5, 0.0).astype(np.float32) / np.float32(part.camera.pixels_per_radian)


def layout_of(rig_views: Sequence[RigView], whole: Spherical, distance_m: float, num_bands: int) -> Layout:
    """Return the views of the cameras in a sphere, taking everything at one distance (0: very far)."""
    far_m = distance_m or VERY_FAR_M
    points = pixel_rays(whole) * far_m
    best = np.zeros((whole.height, whole.width), np.float32)
    owner = np.full(best.shape, OUTSIDE, dtype=np.int8)
    for number, rig_view in enumerate(rig_views):
        border = rig_view.project(points)[2]
        owner[border > best] = number
        best = np.maximum(best, border)
    strips = strips_of(owner, len(rig_views), num_bands)
    views, inverse = [], np.full(best.shape, 1.0 / far_m, np.float32)
    for number, rig_view in enumerate(rig_views):
        is_owned, lens = owner == number, continued_lens(rig_view.lens)
        tiles = tuple(tiles_of(number, is_owned, strips, 1 << num_bands))
        tables = tuple(cv2.convertMaps(*warp(lens, inverse, tile), cv2.CV_16SC2) for tile in tiles)
        views.append(StitchedView(rig_view, lens, is_owned.astype(np.uint8), tiles, tables))
    return Layout(whole, tuple(views), owner, strips)


@cache
def axes_of(shape: tuple[int, ...]) -> tuple[Floats, Floats]:
    """Return sine and cosine of the azimuth of each column (2, W), and of the elevation of each row (2, H)."""
    height, width = shape
    azimuth = (0.5 - (np.arange(width) + 0.5) / width) * 2 * np.pi
    elevation = (0.5 - (np.arange(height) + 0.5) / height) * np.pi
    azimuths, elevations = (np.stack([np.sin(angle), np.cos(angle)]) for angle in (azimuth, elevation))
    return azimuths.astype(np.float32), elevations.astype(np.float32)


def warp(lens: Lens, inverse_range: Floats, block: Block) -> tuple[Floats, Floats]:
    """Return pixels u, v (h, w) of a camera for a block of a sphere whose inverse range (H, W) is known everywhere."""
    u, v = (np.empty((block.height, block.width), np.float32) for _ in range(2))
    warp_by_range(inverse_range, axes_of(inverse_range.shape), block.row, block.column, lens, u, v)
    return u, v


def continued_lens(lens: Lens) -> Lens:
    """Return a lens whose table (S S, 2) has, where the camera sees nothing, what it sees next to it."""
    R, b, extent, table = lens
    *pixels, border = np.moveaxis(table, -1, 0)
    return R, b, extent, np.stack([continued(plane, border > 0).ravel() for plane in pixels], axis=-1)
