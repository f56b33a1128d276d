"""Views of one sphere joined by Laplacian pyramids (Burt and Adelson 1983), around the seam as everywhere else.

Where one view has all the weight the image is that view's, to the grey level: pyramids are made in strips along the
seams only. Sharp detail changes from one view to the next over a pixel or two, brightness over the width of the
coarsest band.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.constants import GRID_STEP, INVERSE_LEVELS
from sphere_mapping.acquisition.kernels import SCALE, add_band, to_levels, warp_by_range
from sphere_mapping.acquisition.stitching.feathering import feather
from sphere_mapping.acquisition.stitching.strips import Block, Strip
from sphere_mapping.acquisition.stitching.views import Layout, StitchedView

Image = NDArray[np.uint8]
Plane = NDArray[np.float32]


def blend(layout: Layout, images: Mapping[str, Image], inverse_range: Plane | None = None) -> Image:
    """Return the image (H, W[, 3]) of the sphere, 1 to 255, and 0 where no camera sees.

    images: by camera, all grey or all RGB. inverse_range (H, W) 1/m, known everywhere: each pixel is taken from where
    its point is seen, not from a common distance.
    """
    whole, colors = layout.whole, images[layout.views[0].name].shape[2:]
    image = np.zeros((whole.height, whole.width, *colors), np.uint8)
    parts = [warp_view(view, images[view.name], inverse_range) for view in layout.views]
    parts = feather(parts, [view.block for view in layout.views], layout.seams, layout.step)
    for view, part in zip(layout.views, parts, strict=True):
        _put(image, part, view.block, view.is_owned)
    for strip in layout.strips:
        rows, columns = strip.inner
        block = Block(
            strip.block.row + rows.start,
            (strip.block.column + columns.start) % whole.width,
            rows.stop - rows.start,
            columns.stop - columns.start,
        )
        is_covered = block.cut(layout.is_covered).astype(np.uint8)
        _put(image, np.ascontiguousarray(_join(strip, layout, parts)[strip.inner]), block, is_covered)
    return image


def warp_view(view: StitchedView, image: Image, inverse_range: Plane | None = None) -> Image:
    """Return the part (h, w[, 3]) of a camera's image in its block of the sphere, 1 to 255."""
    if inverse_range is None:
        part = cv2.remap(image, *view.table, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    else:
        block = view.block
        u, v = (np.empty((block.height, block.width), np.float32) for _ in range(2))
        warp_by_range(view.by_range, INVERSE_LEVELS, GRID_STEP, inverse_range, block.row, block.column, u, v)
        part = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.maximum(part, 1, out=part)


def _put(image: Image, part: Image, block: Block, mask: NDArray[np.uint8]) -> None:
    """Copy a block's part to the sphere where the mask is not 0; its columns wrap around."""
    width, rows = image.shape[1], slice(block.row, block.row + block.height)
    first = min(block.width, width - block.column)
    for columns, place in ((slice(0, first), block.column), (slice(first, min(block.width, width)), 0)):
        size = columns.stop - columns.start
        if size > 0:
            cv2.copyTo(part[:, columns], mask[:, columns], image[rows, place : place + size])


def _join(strip: Strip, layout: Layout, parts: Sequence[Image]) -> Image:
    """Return the mixed image (h, w[, 3]) of a strip's block."""
    is_gray = parts[0].ndim == 2
    block, num_bands = strip.block, len(strip.shares[0].weights) - 1
    totals = _zeros(block, num_bands, 1 if is_gray else 3)
    for share in strip.shares:
        first, last = share.columns.start, share.columns.stop
        wanted = Block(block.row, block.column + first, block.height, last - first)
        part = _cut(parts[share.view], layout.views[share.view].block, wanted, layout.whole.width)
        if wanted == block:
            _add(part, share.weights, totals)
            continue
        own = _zeros(wanted, num_bands, totals[0].shape[2])
        _add(part, share.weights, own)
        for level, (total, band) in enumerate(zip(totals, own, strict=True)):
            total[:, first >> level : last >> level] += band
    joined = totals[-1]
    for total in reversed(totals[:-1]):
        finer = cv2.pyrUp(joined, dstsize=(total.shape[1], total.shape[0])).reshape(total.shape)
        joined = cv2.add(total, finer).reshape(total.shape)
    image = np.empty(joined.shape, np.uint8)
    to_levels(joined, image)
    return image[:, :, 0] if is_gray else image


def _zeros(block: Block, num_bands: int, channels: int) -> list[NDArray[np.int16]]:
    """Return zeros (h >> l, w >> l, channels) for the bands of a block, the finest first."""
    sizes = [block.at(level) for level in range(num_bands + 1)]
    return [np.zeros((size.height, size.width, channels), np.int16) for size in sizes]


def _cut(part: Image, own: Block, wanted: Block, width: int) -> Image:
    """Return a view's part (h, w[, 3]) of a strip's block; beyond what the view has, its border goes on."""
    columns = (np.arange(wanted.width) + wanted.column - own.column) % width
    is_beyond = columns >= own.width
    columns[is_beyond] = np.where(2 * columns[is_beyond] < own.width + width, own.width - 1, 0)
    rows = np.clip(np.arange(wanted.height) + wanted.row - own.row, 0, own.height - 1)
    inside = part[rows[0] : rows[-1] + 1] if rows[-1] - rows[0] + 1 == rows.size else part[rows]
    if columns[-1] - columns[0] + 1 == columns.size:
        return inside[:, columns[0] : columns[-1] + 1]
    return np.take(inside, columns, axis=1)


def _add(image: Image, weights: Sequence[Plane], totals: Sequence[NDArray[np.int16]]) -> None:
    """Add one view's bands to the sums."""
    finest = image
    for weight, total in zip(weights[:-1], totals[:-1], strict=True):
        coarser = cv2.pyrDown(finest)
        smooth = cv2.pyrUp(coarser, dstsize=(finest.shape[1], finest.shape[0]))
        add_band(_three(finest), _three(smooth), weight, total)
        finest = coarser
    add_band(_three(finest), np.zeros_like(_three(finest)), weights[-1], totals[-1])


def _three(image: Image) -> Image:
    return np.ascontiguousarray(image if image.ndim == 3 else image[:, :, None])


assert np.iinfo(np.int16).max > SCALE * 255  # the coarsest band holds whole grey levels
