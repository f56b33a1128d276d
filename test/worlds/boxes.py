"""Boxes along the axes, as triangles."""

from __future__ import annotations

import numpy as np


def box(low, high):
    """Return the corners (36, 3) of the twelve triangles of a box from one corner to the opposite one."""
    x, y, z = zip(low, high, strict=True)
    corners = np.array([[a, b, c] for a in x for b in y for c in z], float)
    quads = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))
    return corners[[index for a, b, c, d in quads for index in (a, b, c, a, c, d)]]
