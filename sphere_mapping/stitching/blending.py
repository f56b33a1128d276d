"""Views of one sphere joined by Laplacian pyramids (Burt and Adelson 1983), around the seam as everywhere else.

Where one view has all the weight the image is that view's, to the grey level; sharp detail changes from one view to
the next over a pixel or two, brightness over the width of the coarsest band.
"""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_mapping.stitching.kernels import SCALE, add_band, to_levels, warp_by_range
from sphere_mapping.stitching.views import GRID_STEP, INVERSE_LEVELS, Layout, View, doubled_around

Image = NDArray[np.uint8]
Plane = NDArray[np.float32]


def blended(layout: Layout, images: Mapping[str, Image], inverse_range: Plane | None = None) -> Image:
    """Return the image (H, W[, 3]) of the sphere, 1 to 255, and 0 where no camera sees.

    images: by camera, all grey or all RGB. inverse_range (H, W) 1/m, known everywhere: each pixel is taken from where
    its point is seen, not from a common distance.
    """
    is_grey = images[layout.views[0].name].ndim == 2
    channels = 1 if is_grey else 3
    whole, num_bands = layout.whole, len(layout.views[0].weights) - 1
    totals = [
        np.zeros((whole.height >> level, whole.width >> level, channels), np.int16) for level in range(num_bands + 1)
    ]
    for view in layout.views:
        _add(view, warped(view, images[view.name], inverse_range), totals)
    joined = totals[-1]
    for total in reversed(totals[:-1]):
        finer = doubled_around(joined).reshape(total.shape)
        joined = cv2.add(total, finer).reshape(total.shape)
    image = np.empty(joined.shape, np.uint8)
    to_levels(joined, layout.is_covered, image)
    return image[:, :, 0] if is_grey else image


def warped(view: View, image: Image, inverse_range: Plane | None = None) -> Image:
    """Return the part (h, w[, 3]) of a camera's image in its block of the sphere."""
    if inverse_range is None:
        return cv2.remap(image, *view.table, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    block = view.block
    u, v = (np.empty((block.height, block.width), np.float32) for _ in range(2))
    warp_by_range(*view.by_range, INVERSE_LEVELS, GRID_STEP, inverse_range, block.row, block.column, u, v)
    return cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def _add(view: View, image: Image, totals: list[NDArray[np.int16]]) -> None:
    """Add one view's bands to the sums."""
    finest = image
    for level, weight in enumerate(view.weights[:-1]):
        coarser = cv2.pyrDown(finest)
        smooth = cv2.pyrUp(coarser, dstsize=(finest.shape[1], finest.shape[0]))
        block = view.block.at(level)
        add_band(_three(finest), _three(smooth), weight, block.row, block.column, totals[level])
        finest = coarser
    block = view.block.at(len(view.weights) - 1)
    add_band(_three(finest), np.zeros_like(_three(finest)), view.weights[-1], block.row, block.column, totals[-1])


def _three(image: Image) -> Image:
    return image if image.ndim == 3 else image[:, :, None]


assert np.iinfo(np.int16).max > SCALE * 255  # the coarsest band holds whole grey levels
