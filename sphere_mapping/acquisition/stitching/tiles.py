"""Which rectangles of a sphere a view is drawn in: what it shows and what strips mix.

A camera that shows a pole has a part in all columns, from the one pole to the other. A third of these is enough.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from sphere_mapping.acquisition.stitching.strips import Block, Strip
from sphere_nav.geometry.arrays import Flags

ROWS = 4  # cells of a tile: as wide as it is needed anywhere in them


def tiles_of(view: int, is_owned: Flags, strips: Sequence[Strip], step: int) -> Iterator[Block]:
    """Yield the rectangles of the sphere in which a view is needed, in multiples of `step`.

    is_owned: (H, W), where the sphere shows the view.
    """
    height, width = (side // step for side in is_owned.shape)
    is_used: Flags = np.asarray(np.any(is_owned.reshape(height, step, width, step), axis=(1, 3)), np.bool_)
    for strip in strips:
        for share in strip.shares:
            if share.view == view:
                part = strip.part(share)
                columns = np.arange(part.column, part.column + part.width, step) // step % width
                is_used[part.row // step : (part.row + part.height) // step, columns] = True
    for top in range(0, height, ROWS):
        used = np.any(is_used[top : top + ROWS], axis=0)
        edges = np.flatnonzero(np.diff(used, prepend=False, append=False))
        for first, last in edges.reshape(-1, 2).tolist():
            yield Block(top * step, first * step, min(ROWS, height - top) * step, (last - first) * step)
