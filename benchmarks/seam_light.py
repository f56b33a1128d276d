"""How much light differs across the seams of a sphere: all pixels that two cameras share, those without detail, too."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.stitching.blending import warp_view
from sphere_mapping.acquisition.stitching.stitcher import Stitcher
from sphere_mapping.acquisition.stitching.views import Block, Layout, block_rays

Image = NDArray[np.uint8]

BAND_DEG = 8.0  # to either side of a seam
BLUR_DEG = 1.5  # what is compared is the mean of so much: parallax of fine detail does not count
FROM_BORDER = 0.02  # rad
RANGE = (5.0, 250.0)  # grey levels between which a ratio means anything


@dataclass(frozen=True)
class Step:
    """Steps of light, logarithms of ratios: median size over all pixels of all seams, and of the worst seam.

    median: of the absolute values of all; worst: the largest absolute median of a seam; colour: the largest difference
    of two colours' medians at a seam; num_seams: how many there are.
    """

    median: float
    worst: float
    color: float
    num_seams: int


def light_step(stitcher: Stitcher, images: Mapping[str, Image], level: str, inverse: NDArray | None = None) -> Step:
    """Compare neighbouring views of a level of the sphere near their seams, drawn as `stitch` draws them."""
    layout = stitcher.layouts.of(level, tuple(images))
    planes = [_on_sphere(layout, k, images, inverse) for k in range(len(layout.views))]
    sizes, medians, colors = [np.zeros(0)], [], []
    for i, j in combinations(range(len(planes)), 2):
        both = planes[i][1] & planes[j][1] & _near_seam(layout, i, j)
        if not both.any():
            continue
        first, second = planes[i][0][both], planes[j][0][both]
        fits = (np.minimum(first, second).min(axis=1) > RANGE[0]) & (np.maximum(first, second).max(axis=1) < RANGE[1])
        if np.count_nonzero(fits) < 100:
            continue
        ratio = np.log(first[fits] / second[fits])
        sizes.append(np.abs(ratio.mean(axis=1)))
        medians.append(abs(float(np.median(ratio.mean(axis=1)))))
        channels = np.median(ratio, axis=0)
        colors.append(float(channels.max() - channels.min()))
    every = np.concatenate(sizes)
    if not medians:
        return Step(float("nan"), float("nan"), float("nan"), 0)
    return Step(float(np.median(every)), max(medians), max(colors), len(medians))


def _on_sphere(
    layout: Layout, number: int, images: Mapping[str, Image], inverse: NDArray | None
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return a view's blurred levels (H, W, channels), and where it sees."""
    view, whole = layout.views[number], layout.whole
    image = images[view.name]
    part = warp_view(view, image, inverse).reshape(view.block.height, view.block.width, -1)
    columns = np.arange(view.block.column, view.block.column + min(view.block.width, whole.width)) % whole.width
    rows = slice(view.block.row, view.block.row + view.block.height)
    rays = block_rays(whole, Block(view.block.row, view.block.column, view.block.height, columns.size))
    sees = view.rig_view.project(rays * 20.0)[2] > FROM_BORDER
    side = round(BLUR_DEG * whole.width / 360.0)
    weight = np.maximum(cv2.blur(sees.astype(np.float32), (side, side)), 1e-6)
    blurred = cv2.blur(part[:, : columns.size].astype(np.float32) * sees[..., None], (side, side))
    plane = np.zeros((whole.height, whole.width, part.shape[2]), np.float32)
    seen = np.zeros((whole.height, whole.width), np.bool_)
    plane[rows, columns] = blurred.reshape(*sees.shape, -1) / weight[..., None]
    seen[rows, columns] = sees
    return plane, seen


def _near_seam(layout: Layout, i: int, j: int) -> NDArray[np.bool_]:
    side = 2 * round(BAND_DEG * layout.whole.width / 360.0) + 1
    kernel = np.ones((side, side), np.uint8)
    wide = [cv2.copyMakeBorder((layout.owner == k).astype(np.uint8), 0, 0, side, side, cv2.BORDER_WRAP) for k in (i, j)]
    return (cv2.dilate(wide[0], kernel) & cv2.dilate(wide[1], kernel))[:, side:-side] > 0
