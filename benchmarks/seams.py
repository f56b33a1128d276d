"""How well the views of a rig lie on each other, by optical flow: at seams, and between top and bottom."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.range.fusion import inverse_range
from sphere_mapping.acquisition.range.vertical import VerticalStereo
from sphere_mapping.acquisition.stitching.blending import warp_view
from sphere_mapping.acquisition.stitching.stitcher import Stitcher
from sphere_mapping.acquisition.stitching.views import Layout, StitchedView
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.spheres.sphere import continued

Image = NDArray[np.uint8]
Flags = NDArray[np.bool_]

BAND_DEG = 8.0  # to either side of a seam
WINDOW = 15  # px, side of the block that is followed; all of it must be seen by both cameras
FROM_BORDER = 0.01  # rad
MAX_RETURN = 0.5  # px: followed there and back again a corner must return this near, else it was lost
SHARP = 60.0  # Sobel's slope across columns of detail whose column is well known


@dataclass(frozen=True)
class Flow:
    """Median length in px of the flow, and of how many corners, out of how many, it is known."""

    median: float
    num_followed: int
    num_corners: int


def seam_flow(
    stitcher: Stitcher, images: Mapping[str, Image], level: str, range_m: NDArray[np.float32], min_range_m: float
) -> Flow:
    """Follow corners from one camera's view of the sphere to the next one's, both drawn as `stitch` draws them.

    Only corners near the seam of the two, that both see, near what is measured, nothing of which is less far away.
    """
    layout = stitcher.layouts.of(level, tuple(images))
    inverse = inverse_range(range_m, layout.is_covered)
    is_distant = distant(range_m, min_range_m)
    lengths, num_corners = [np.zeros(0)], 0
    for i, j in combinations(range(len(layout.views)), 2):
        planes = [_on_sphere(layout.views[k], images, layout, inverse) for k in (i, j)]
        chosen = planes[0][1] & planes[1][1] & is_distant & _near_seam(layout, i, j)
        if not chosen.any():
            continue
        half = layout.whole.width // 2 - int(np.median(np.flatnonzero(chosen.any(axis=0))))
        first, second = (np.roll(even(plane[0]), half, axis=1) for plane in planes)
        found, number = followed(first, second, np.roll(chosen, half, axis=1))
        lengths.append(np.linalg.norm(found, axis=1))
        num_corners += number
    every = np.concatenate(lengths)
    return Flow(float(np.median(every)) if every.size else float("nan"), every.size, num_corners)


def distant(range_m: NDArray[np.float32], min_range_m: float) -> Flags:
    """Return the pixels (H, W) beside measured ones, which all are at least so far away; LiDARs measure sparsely."""
    kernel = np.ones((WINDOW, WINDOW), np.uint8)
    known = np.isfinite(range_m)
    nearest = cv2.erode(np.where(known, range_m, np.float32(np.inf)), kernel)
    return (cv2.dilate(known.astype(np.uint8), kernel) > 0) & (nearest >= min_range_m)


def column_shift(stitcher: Stitcher, images: Mapping[str, Image], range_m: NDArray[np.float32]) -> Flow:
    """Return by how many columns detail of the top sphere is elsewhere in the bottom one, within 45 deg of level.

    The bottom sphere is drawn at the rows where the range puts them; what is left is the error of columns (and of
    range, which does not count).
    """
    assert isinstance(stitcher.stereo, VerticalStereo)
    equal, _ = stitcher.equalize(images)
    grays = {
        name: cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) if image.ndim == 3 else image for name, image in equal.items()
    }
    layouts = [stitcher.layouts.of(level, tuple(grays)) for level in ("top", "bottom")]
    top, bottom = (even(plane) for plane in stitcher.stereo.draw(layouts, grays, range_m))
    height, width = top.shape
    known = np.isfinite(range_m)
    disparity = _row_disparity(range_m, stitcher.layouts.baseline_m)
    rows, columns = np.mgrid[0:height, 0:width].astype(np.float32)
    rows -= continued(disparity, known)
    moved = cv2.remap(bottom, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    middle = np.abs(np.arange(height) - height / 2) < height / 4
    is_sharp = np.abs(cv2.Sobel(top, cv2.CV_32F, 1, 0)) > SHARP
    chosen = layouts[0].is_covered & layouts[1].is_covered & known & middle[:, None] & is_sharp
    found, number = followed(top, moved, chosen)
    shifts = np.abs(found[:, 0])
    return Flow(float(np.median(shifts)) if shifts.size else float("nan"), shifts.size, number)


def followed(first: Image, second: Image, chosen: Flags) -> tuple[NDArray[np.float32], int]:
    """Return the flow (N, 2) of corners of `first` that are found again, and how many corners there are."""
    inner = cv2.erode(chosen.astype(np.uint8), np.ones((3, 3), np.uint8))
    corners = cv2.goodFeaturesToTrack(first, 4000, 0.02, 5, mask=inner)
    if corners is None:
        return np.zeros((0, 2), np.float32), 0
    options = {"winSize": (WINDOW, WINDOW), "maxLevel": 2}
    there, ok, _ = cv2.calcOpticalFlowPyrLK(first, second, corners, None, **options)
    back, ok_back, _ = cv2.calcOpticalFlowPyrLK(second, first, there, None, **options)
    returns = np.linalg.norm(back - corners, axis=2) < MAX_RETURN
    good = ((ok > 0) & (ok_back > 0) & returns)[:, 0]
    return (there - corners)[good, 0], len(corners)


def even(image: Image) -> Image:
    """Return the image with its local mean and contrast made equal: cameras expose differently."""
    gray = image.astype(np.float32)
    mean = cv2.blur(gray, (31, 31))
    deviation = np.sqrt(np.maximum(cv2.blur(gray * gray, (31, 31)) - mean * mean, 0.0))
    return np.clip(128 + 50 * (gray - mean) / (deviation + 4), 0, 255).astype(np.uint8)


def _on_sphere(
    view: StitchedView, images: Mapping[str, Image], layout: Layout, inverse: NDArray[np.float32] | None
) -> tuple[Image, Flags]:
    """Return a view's grey levels (H, W) and where all of a window around a pixel is seen by it."""
    image, whole = images[view.name], layout.whole
    gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) if image.ndim == 3 else image
    plane, seen = np.zeros((whole.height, whole.width), np.uint8), np.zeros((whole.height, whole.width), np.uint8)
    columns = np.arange(view.block.column, view.block.column + min(view.block.width, whole.width)) % whole.width
    rows = slice(view.block.row, view.block.row + view.block.height)
    plane[rows, columns] = warp_view(view, gray, inverse)[:, : columns.size]
    rays = pixel_rays(whole)[rows][:, columns]
    seen[rows, columns] = view.rig_view.project(rays * 20.0)[2] > FROM_BORDER
    return plane, cv2.erode(seen, np.ones((WINDOW, WINDOW), np.uint8)) > 0


def _near_seam(layout: Layout, i: int, j: int) -> Flags:
    side = 2 * round(BAND_DEG * layout.whole.width / 360.0) + 1
    kernel = np.ones((side, side), np.uint8)
    wide = [cv2.copyMakeBorder((layout.owner == k).astype(np.uint8), 0, 0, side, side, cv2.BORDER_WRAP) for k in (i, j)]
    return (cv2.dilate(wide[0], kernel) & cv2.dilate(wide[1], kernel))[:, side:-side] > 0


def _row_disparity(range_m: NDArray[np.float32], baseline_m: float) -> NDArray[np.float32]:
    """Return by how many rows what is at this range is higher in the bottom sphere."""
    height = range_m.shape[0]
    above = ((np.arange(height) + 0.5) * np.pi / height)[:, None]
    below = np.arctan2(range_m * np.sin(above), range_m * np.cos(above) + baseline_m)
    return ((above - below) * height / np.pi).astype(np.float32)
