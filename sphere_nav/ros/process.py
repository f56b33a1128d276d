"""How a process gives memory back to the system (glibc; with other C libraries nothing happens).

How threads of Python take turns: one runs Python at a time.
"""

from __future__ import annotations

import ctypes
import re
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

TURN_S = 5e-4  # after which a thread lets another one run that waits; 10 times that by itself


def take_short_turns() -> None:
    """Have what works in the background hold up an image for a moment only, each time that the image needs Python."""
    sys.setswitchinterval(TURN_S)


TRIM_THRESHOLD, MMAP_THRESHOLD = -1, -3  # names of mallopt(3)
LARGE = 1 << 20  # bytes: planes of key spheres, not what an image of a camera needs
COMPILER = "libllvmlite"  # has loaded the kernels, and has nothing more to do: 70 MB of its code
CODE = re.compile(r"([0-9a-f]+)-([0-9a-f]+) r-xp \S+ \S+ \d+ +(/.*)")  # of a file, in /proc/self/maps
DONTNEED = 4  # of madvise(2)
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
    """Give back what is free now, small blocks included, and the compiler's code; some milliseconds."""
    with suppress(AttributeError, OSError):
        ctypes.CDLL(None).malloc_trim(0)
        _return_code(COMPILER)


def _return_code(library: str) -> None:
    """Give back the pages of a library's code; what is used again of it is mapped again from the file."""
    madvise = ctypes.CDLL(None).madvise
    madvise.argtypes = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int
    for line in Path("/proc/self/maps").read_text(encoding="utf-8").splitlines():
        found = CODE.match(line)  # code is never written to: nothing is lost
        if found is not None and library in found[3]:
            first, end = (int(word, 16) for word in found.groups()[:2])
            madvise(first, end - first, DONTNEED)
