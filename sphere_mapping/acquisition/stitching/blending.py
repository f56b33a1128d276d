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

from sphere_mapping.acquisition.kernels import add_band
from sphere_mapping.acquisition.stitching.strips import Block, Strip
from sphere_mapping.acquisition.stitching.views import Layout, StitchedView, warp
from sphere_nav.geometry import Spherical
from sphere_nav.geometry.arrays import Bytes, Floats


def blend(layout: Layout, images: Mapping[str, Bytes], inverse_range: Floats | None = None) -> Bytes:
    """Return the image (H, W[, 3]) of the sphere, 1 to 255, and 0 where no camera sees.

    images: by camera, all grey or all RGB. inverse_range (H, W) 1/m, known everywhere: each pixel is taken from where
    its point is seen, not from a common distance.
    """
    whole, colors = layout.whole, images[layout.views[0].rig_view.name].shape[2:]
    image = np.zeros((whole.height, whole.width, *colors), np.uint8)
    parts = [warp_view(view, images[view.rig_view.name], whole, inverse_range) for view in layout.views]
    for view, part in zip(layout.views, parts, strict=True):
        for tile in view.tiles:
            cv2.copyTo(part[tile.slices()], view.is_owned[tile.slices()], image[tile.slices()])
    is_covered = layout.is_covered.astype(np.uint8)
    for strip in layout.strips:
        inner = strip.shown.slices(strip.block.row, strip.block.column)
        _put(image, np.ascontiguousarray(_join(strip, parts)[inner]), strip.shown, is_covered)
    return image


def warp_view(view: StitchedView, image: Bytes, whole: Spherical, inverse_range: Floats | None = None) -> Bytes:
    """Return what a camera's image shows of a sphere (H, W[, 3]), 1 to 255; 0 outside of its tiles."""
    part = np.zeros((whole.height, whole.width, *image.shape[2:]), np.uint8)
    for tile, table in zip(view.tiles, view.tables, strict=True):
        maps = table if inverse_range is None else warp(view.lens, inverse_range, tile)
        drawn = cv2.remap(image, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        np.maximum(drawn, 1, out=part[tile.slices()])
    return part


def _put(image: Bytes, part: Bytes, block: Block, mask: Bytes) -> None:
    """Copy a block's part to the sphere where the mask (H, W) is not 0; its columns wrap around."""
    width, rows = image.shape[1], slice(block.row, block.row + block.height)
    first = min(block.width, width - block.column)
    for columns, place in ((slice(0, first), block.column), (slice(first, block.width), 0)):
        size = columns.stop - columns.start
        if size > 0:
            to = rows, slice(place, place + size)
            cv2.copyTo(part[:, columns], mask[to], image[to])


def _join(strip: Strip, parts: Sequence[Bytes]) -> Bytes:
    """Return the mixed image (h, w[, 3]) of a strip's block."""
    is_gray = parts[0].ndim == 2
    block, num_bands = strip.block, len(strip.shares[0].weights) - 1
    totals = _zeros(block, num_bands, 1 if is_gray else 3)
    for share in strip.shares:
        wanted = strip.part(share)
        part = wanted.cut(parts[share.view])
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


def _add(image: Bytes, weights: Sequence[Floats], totals: Sequence[NDArray[np.int16]]) -> None:
    """Add one view's bands to the sums."""
    finest = image
    for weight, total in zip(weights[:-1], totals[:-1], strict=True):
        coarser = cv2.pyrDown(finest)
        smooth = cv2.pyrUp(coarser, dstsize=(finest.shape[1], finest.shape[0]))
        add_band(*(plane.reshape(len(total), -1) for plane in (finest, smooth)), weight, total.reshape(len(total), -1))
        finest = coarser
    last = totals[-1].reshape(len(finest), -1)
    add_band(finest.reshape(last.shape), np.zeros(last.shape, np.uint8), weights[-1], last)
