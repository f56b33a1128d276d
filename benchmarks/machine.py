"""Which machine measured, and how its clock is read."""

from __future__ import annotations

import os
import platform
import subprocess
import time
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

LIBRARIES = ("numpy", "numba", "opencv-python-headless")


def num_cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0))


def describe(num_threads: int) -> str:
    """Return one line: processor, cores, threads, versions."""
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    name = next(
        (line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "unknown processor"
    )
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in LIBRARIES)
    threads = f"{num_threads} thread{'s' if num_threads > 1 else ''}"
    return f"{name}, {num_cores()} cores, {threads}; python {platform.python_version()}, {versions}"


def commit() -> str:
    """Return the commit of the checkout, with a plus where files differ from it."""
    call = ["git", "describe", "--always", "--dirty=+", "--exclude=*"]
    found = subprocess.run(call, cwd=Path(__file__).parent, capture_output=True, text=True, check=False)
    return found.stdout.strip() or "unknown"


def set_threads(num_threads: int) -> None:
    """Give OpenCV, numba and OpenMP (before it is imported) the same number of threads."""
    os.environ["OMP_NUM_THREADS"] = str(num_threads)
    import cv2
    import numba

    cv2.setNumThreads(num_threads)
    numba.set_num_threads(num_threads)


def repeat_cpu(call: Callable[[], Any], num_runs: int, num_warm_up: int = 3) -> np.ndarray:
    """Return the CPU times (num_runs,) in ms of this thread: what else runs on the machine counts little."""
    for _ in range(num_warm_up):
        call()
    times = np.empty(num_runs)
    for run in range(num_runs):
        start = time.thread_time_ns()
        call()
        times[run] = (time.thread_time_ns() - start) / 1e6
    return times
