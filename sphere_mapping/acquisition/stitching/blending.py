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

from sphere_mapping.acquisition.stitching.strips import Block, Strip
from sphere_mapping.acquisition.stitching.views import Layout, StitchedView, warp
from sphere_nav.geometry.arrays import Bytes, Floats


def blend(layout: Layout, images: Mapping[str, Bytes], inverse_range: Floats | None = None) -> Bytes:
    """Return the image (H, W[, 3]) of the sphere, 1 to 255, and 0 where no camera sees.

    images: by camera, all grey or all RGB. inverse_range (H, W) 1/m, known everywhere: each pixel is taken from where
    its point is seen, not from a common distance.
    """
    whole, colors = layout.whole, images[layout.views[0].rig_view.name].shape[2:]
    image = np.zeros((whole.height, whole.width, *colors), np.uint8)
    parts = [
        warp_view(view, images[view.rig_view.name], inverse_range, tiles)
        for view, tiles in zip(layout.views, layout.tiles, strict=True)
    ]
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


def warp_view(
    view: StitchedView, image: Bytes, inverse_range: Floats | None = None, tiles: Sequence[Block] | None = None
) -> Bytes:
    """Return the part (h, w[, 3]) of a camera's image in its block of the sphere, 1 to 255.

    tiles: what is needed of it, by the place in the block; 0 elsewhere.
    """
    block = view.block
    part = np.zeros((block.height, block.width, *image.shape[2:]), np.uint8)
    for tile in (Block(0, 0, block.height, block.width),) if tiles is None else tiles:
        rows, columns = slice(tile.row, tile.row + tile.height), slice(tile.column, tile.column + tile.width)
        if inverse_range is None:
            maps = tuple(table[rows, columns] for table in view.table)
        else:
            place = Block(block.row + tile.row, block.column + tile.column, tile.height, tile.width)
            maps = warp(view.lens, inverse_range, place)
        drawn = cv2.remap(image, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        np.maximum(drawn, 1, out=part[rows, columns])
    return part


def _put(image: Bytes, part: Bytes, block: Block, mask: Bytes) -> None:
    """Copy a block's part to the sphere where the mask is not 0; its columns wrap around."""
    width, rows = image.shape[1], slice(block.row, block.row + block.height)
    first = min(block.width, width - block.column)
    for columns, place in ((slice(0, first), block.column), (slice(first, block.width), 0)):
        size = columns.stop - columns.start
        if size > 0:
            cv2.copyTo(part[:, columns], mask[:, columns], image[rows, place : place + size])


def _join(strip: Strip, layout: Layout, parts: Sequence[Bytes]) -> Bytes:
    """Return the mixed image (h, w[, 3]) of a strip's block."""
    is_gray = parts[0].ndim == 2
    block, num_bands = strip.block, len(strip.shares[0].weights) - 1
    totals = _zeros(block, num_bands, 1 if is_gray else 3)
    for share in strip.shares:
        wanted = strip.part(share)
        part = _cut(parts[share.view], layout.views[share.view].block, wanted, layout.whole.width)
        if wanted == block:
            _add(part, share.weights, totals)
            continue
        own = _zeros(wanted, num_bands, totals[0].shape[2])
        _add(part, share.weights, own)
        for level, (total, band) in enumerate(zip(totals, own, strict=True)):
            total[:, share.columns.start >> level : share.columns.stop >> level] += band
    joined = totals[-1]
    for total in reversed(totals[:-1]):
        finer = cv2.pyrUp(joined, dstsize=(total.shape[1], total.shape[0])).reshape(total.shape)
        joined = cv2.add(total, finer).reshape(total.shape)
    image = np.clip((joined + 8) >> 4, 1, 255).astype(np.uint8)  # of sixteenths
    return image[:, :, 0] if is_gray else image


def _zeros(block: Block, num_bands: int, channels: int) -> list[NDArray[np.int16]]:
    """Return zeros (h >> l, w >> l, channels) for the bands of a block, the finest first."""
    sizes = [block.at(level) for level in range(num_bands + 1)]
    return [np.zeros((size.height, size.width, channels), np.int16) for size in sizes]


def _cut(part: Bytes, own: Block, wanted: Block, width: int) -> Bytes:
    """Return a view's part (h, w[, 3]) of a strip's block; beyond what the view has, its border goes on."""
    rows, columns = own.places_of(wanted, width)
    inside = part[rows[0] : rows[-1] + 1] if rows[-1] - rows[0] + 1 == rows.size else part[rows]
    if columns[-1] - columns[0] + 1 == columns.size:
        return inside[:, columns[0] : columns[-1] + 1]
    return np.take(inside, columns, axis=1)


def _add(image: Bytes, weights: Sequence[Floats], totals: Sequence[NDArray[np.int16]]) -> None:
    """Add one view's bands to the sums."""
    finest = image
    for weight, total in zip(weights[:-1], totals[:-1], strict=True):
        coarser = cv2.pyrDown(finest)
        smooth = cv2.pyrUp(coarser, dstsize=(finest.shape[1], finest.shape[0]))
        _add_band(cv2.subtract(finest, smooth, dtype=cv2.CV_32F), weight, total)
        finest = coarser
    _add_band(finest, weights[-1], totals[-1])


def _add_band(band: Bytes | Floats, weight: Floats, total: NDArray[np.int16]) -> None:
    """Add a band (h, w[, c]) by its weight (h, w) to a sum (h, w, c), in sixteenths of a grey level."""
    share = np.float32(16.0) * weight[..., None]
    total += np.floor(share * band.reshape(total.shape) + np.float32(0.5)).astype(np.int16)
