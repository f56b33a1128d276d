"""Which part of a view's block a sphere needs: what it shows and what strips mix.

The block of a camera that shows a pole has all columns, from the one pole to the other. A third of it is enough.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from sphere_mapping.acquisition.stitching.strips import Block, Strip
from sphere_nav.geometry.arrays import Bytes, Flags

ROWS = 4  # cells of a tile: as wide as it is needed anywhere in them


def tiles_of(
    view: int,
    block: Block,
    is_owned: Bytes,
    strips: Sequence[Strip],
    step: int,
    width: int,
) -> tuple[Block, ...]:
    """Return the rectangles of a view's block that are needed, by their place in it, in multiples of `step`.

    is_owned: (h, w) of the block, not 0 where the sphere of `width` columns shows the view.
    """
    rows, columns = block.height // step, block.width // step
    is_used: Flags = np.asarray(np.any((is_owned > 0).reshape(rows, step, columns, step), axis=(1, 3)), np.bool_)
    for strip in strips:
        for share in strip.shares:
            if share.view == view:
                places = block.places_of(strip.part(share), width)
                is_used[np.ix_(*(np.unique(at // step) for at in places))] = True
    return tuple(_rectangles(is_used, step))


def _rectangles(is_used: Flags, step: int) -> Iterator[Block]:
    """Yield rectangles of so many rows of cells (h, w), each as wide as what is used in one of them."""
    for top in range(0, len(is_used), ROWS):
        used = np.any(is_used[top : top + ROWS], axis=0)
        edges = np.flatnonzero(np.diff(used, prepend=False, append=False))
        height = min(ROWS, len(is_used) - top)
        for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            yield Block(top * step, first * step, height * step, (last - first) * step)
