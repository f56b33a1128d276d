"""How well the views of a rig lie on each other: detail by optical flow, light by the ratio of what both see."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.range.fusion import inverse_range
from sphere_mapping.acquisition.stitching.blending import warp_view
from sphere_mapping.acquisition.stitching.stitcher import Stitcher
from sphere_mapping.acquisition.stitching.views import Block, Layout, block_rays

Image = NDArray[np.uint8]
Flags = NDArray[np.bool_]
Images = Mapping[str, Image]

BAND_DEG, FROM_BORDER = 8.0, 0.02  # to either side of a seam; rad from the border of a view
WINDOW, MAX_RETURN = 15, 0.5  # px: block that is followed, seen by both; there and back again a corner is so near
BLUR_DEG = 1.5  # light is compared by means of so much: parallax of fine detail does not count
LEVELS = (5.0, 250.0)  # grey levels between which a ratio means anything


@dataclass(frozen=True)
class Flow:
    """Median length in px of the flow, and of how many corners it is known."""

    median: float
    num_followed: int


def seam_flow(stitcher: Stitcher, images: Images, level: str, range_m: NDArray[np.float32], min_range_m: float) -> Flow:
    """Follow corners from one camera's view of the sphere to the next one's, both drawn as `stitch` draws them.

    Only corners near the seam of the two, that both see, near what is measured, nothing of which is less far away.
    """
    layout = stitcher.layouts.of(level, tuple(images))
    inverse, is_distant = inverse_range(range_m, layout.is_covered), distant(range_m, min_range_m)
    planes = [_drawn(layout, k, _grays(images), inverse) for k in range(len(layout.views))]
    lengths = [np.zeros(0)]
    for i, j, near in _seams(layout):
        sees = (cv2.erode(planes[k][1].astype(np.uint8), np.ones((WINDOW, WINDOW), np.uint8)) > 0 for k in (i, j))
        chosen = near & is_distant & next(sees) & next(sees)
        if not chosen.any():
            continue
        half = layout.whole.width // 2 - int(np.median(np.flatnonzero(chosen.any(axis=0))))
        first, second = (np.roll(even(planes[k][0][..., 0]), half, axis=1) for k in (i, j))
        lengths.append(np.linalg.norm(followed(first, second, np.roll(chosen, half, axis=1)), axis=1))
    every = np.concatenate(lengths)
    return Flow(float(np.median(every)) if every.size else np.nan, every.size)


def light_step(stitcher: Stitcher, images: Images, level: str) -> tuple[float, float]:
    """Return the median size of the steps of light over all pixels of all seams, and the worst seam's median.

    Steps are logarithms of the ratio of two neighbouring views near their seam, drawn as `stitch` draws them.
    """
    layout = stitcher.layouts.of(level, tuple(images))
    side = round(BLUR_DEG * layout.whole.width / 360.0)
    planes = []
    for k in range(len(layout.views)):
        plane, sees = _drawn(layout, k, images, None)
        weight = np.maximum(cv2.blur(sees.astype(np.float32), (side, side)), 1e-6)
        means = cv2.blur(plane.astype(np.float32) * sees[..., None], (side, side)).reshape(plane.shape)
        planes.append((means / weight[..., None], sees))
    sizes, medians = [np.zeros(0)], [np.nan]
    for i, j, near in _seams(layout):
        both = near & planes[i][1] & planes[j][1]
        first, second = planes[i][0][both], planes[j][0][both]
        fits = np.all((np.minimum(first, second) > LEVELS[0]) & (np.maximum(first, second) < LEVELS[1]), axis=1)
        if np.count_nonzero(fits) >= 100:
            ratio = np.log(first[fits] / second[fits]).mean(axis=1)
            sizes.append(np.abs(ratio))
            medians.append(abs(float(np.median(ratio))))
    every = np.concatenate(sizes)
    return (float(np.median(every)), float(np.nanmax(medians))) if every.size else (np.nan, np.nan)


def distant(range_m: NDArray[np.float32], min_range_m: float) -> Flags:
    """Return the pixels (H, W) beside measured ones, which all are at least so far away; LiDARs measure sparsely."""
    kernel, known = np.ones((WINDOW, WINDOW), np.uint8), np.isfinite(range_m)
    nearest = cv2.erode(np.where(known, range_m, np.float32(np.inf)), kernel)
    return (cv2.dilate(known.astype(np.uint8), kernel) > 0) & (nearest >= min_range_m)


def followed(first: Image, second: Image, chosen: Flags) -> NDArray[np.float32]:
    """Return the flow (N, 2) of corners of `first` that are found again."""
    inner = cv2.erode(chosen.astype(np.uint8), np.ones((3, 3), np.uint8))
    corners = cv2.goodFeaturesToTrack(first, 4000, 0.02, 5, mask=inner)
    if corners is None:
        return np.zeros((0, 2), np.float32)
    options = {"winSize": (WINDOW, WINDOW), "maxLevel": 2}
    there, ok, _ = cv2.calcOpticalFlowPyrLK(first, second, corners, None, **options)
    back, ok_back, _ = cv2.calcOpticalFlowPyrLK(second, first, there, None, **options)
    returns = np.linalg.norm(back - corners, axis=2) < MAX_RETURN
    return (there - corners)[((ok > 0) & (ok_back > 0) & returns)[:, 0], 0]


def even(image: Image) -> Image:
    """Return the image with its local mean and contrast made equal: cameras expose differently."""
    gray = image.astype(np.float32)
    mean = cv2.blur(gray, (31, 31))
    deviation = np.sqrt(np.maximum(cv2.blur(gray * gray, (31, 31)) - mean * mean, 0.0))
    return np.clip(128 + 50 * (gray - mean) / (deviation + 4), 0, 255).astype(np.uint8)


def _grays(images: Images) -> dict[str, Image]:
    return {name: cv2.cvtColor(one, cv2.COLOR_RGB2GRAY) if one.ndim == 3 else one for name, one in images.items()}


def _drawn(layout: Layout, number: int, images: Images, inverse: NDArray[np.float32] | None) -> tuple[Image, Flags]:
    """Return a view's levels (H, W, channels) on the sphere, and where it sees."""
    view, whole, block = layout.views[number], layout.whole, layout.views[number].block
    part = warp_view(view, images[view.name], inverse)
    part = part.reshape(*part.shape[:2], -1)
    columns = np.arange(block.column, block.column + min(block.width, whole.width)) % whole.width
    rows = slice(block.row, block.row + block.height)
    plane, sees = np.zeros((whole.height, whole.width, part.shape[2]), np.uint8), np.zeros(layout.owner.shape, np.bool_)
    plane[rows, columns] = part[:, : columns.size]
    rays = block_rays(whole, Block(block.row, block.column, block.height, columns.size))
    sees[rows, columns] = view.rig_view.project(rays * 20.0)[2] > FROM_BORDER
    return plane, sees


def _seams(layout: Layout) -> Iterator[tuple[int, int, Flags]]:
    """Yield pairs of neighbouring views, and the pixels (H, W) near the seam of the two."""
    side = 2 * round(BAND_DEG * layout.whole.width / 360.0) + 1
    wide = []
    for k in range(len(layout.views)):
        owned = cv2.copyMakeBorder((layout.owner == k).astype(np.uint8), 0, 0, side, side, cv2.BORDER_WRAP)
        wide.append(cv2.dilate(owned, np.ones((side, side), np.uint8))[:, side:-side] > 0)
    for i, j in combinations(range(len(wide)), 2):
        if (near := wide[i] & wide[j]).any():
            yield i, j, near
