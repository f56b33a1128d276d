"""What arrays of numbers are called in signatures (shapes and units stand in the docstrings), and how they are used."""

from __future__ import annotations

import mmap
from math import prod
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import DTypeLike, NDArray

Array: TypeAlias = NDArray[np.float64]
Floats: TypeAlias = NDArray[np.float32]  # many numbers: pixels, points
Bytes: TypeAlias = NDArray[np.uint8]
Flags: TypeAlias = NDArray[np.bool_]
Integers: TypeAlias = NDArray[np.int64]
Size: TypeAlias = tuple[int, int]  # width and height of an image, px

PLANAR = np.ix_((0, 1, 5), (0, 1, 5))  # x, y, yaw of the covariance of a tangent vector (v, omega)
TINY = 1e-12  # keeps divisors from 0; nothing that is measured is as small

OWN_PAGES = 1 << 14  # bytes, from which an array that stays has pages of its own: of the last a quarter at most is lost
HUGE_PAGES = 1 << 22  # bytes, from which NumPy asks for large pages, too


def arc_lengths(points: Array) -> Array:
    """Return how far along a line through points (N, 2) each of them is (N,)."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])


def empty_to_keep(shape: int | tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Return an array that is to stay while images come and go; its memory leaves the process with it.

    In the heap of the C library it would lie between the arrays of images. Whenever one that stayed goes, a gap is left
    that fits nothing: a process that exchanges key spheres grows for hours, though it holds no more than before.
    """
    num_bytes = prod(np.atleast_1d(shape).tolist()) * np.dtype(dtype).itemsize
    if num_bytes < OWN_PAGES:
        return np.empty(shape, dtype)
    pages = mmap.mmap(-1, num_bytes, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    if num_bytes >= HUGE_PAGES and hasattr(mmap, "MADV_HUGEPAGE"):
        pages.madvise(mmap.MADV_HUGEPAGE)
    return np.ndarray(shape, dtype, buffer=pages)
