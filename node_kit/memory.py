"""How a process gives memory back to the system (glibc; with other C libraries nothing happens)."""

from __future__ import annotations

import ctypes
from contextlib import suppress
from typing import Any

TRIM_THRESHOLD, MMAP_THRESHOLD = -1, -3  # names of mallopt(3)
LARGE = 1 << 20  # bytes: planes of key spheres, not what an image of a camera needs
SPARE = 1 << 25  # bytes that stay for the next image


def return_large_blocks() -> None:
    """Have every large array given back when it is freed.

    By itself glibc raises the limit to the largest block freed so far, 32 MB at most, and keeps what is below it:
    pictures that come and go in several threads leave hundreds of megabytes in pieces that fit nothing.
    """
    with suppress(AttributeError, OSError):
        libc: Any = ctypes.CDLL(None)
        libc.mallopt(MMAP_THRESHOLD, LARGE)
        libc.mallopt(TRIM_THRESHOLD, SPARE)


def return_free_memory() -> None:
    """Give back what is free now, small blocks included; some milliseconds."""
    with suppress(AttributeError, OSError):
        ctypes.CDLL(None).malloc_trim(0)
