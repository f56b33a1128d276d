"""Readers that misbehave, for a process of their own."""

import os
import time
from pathlib import Path

import numpy as np

UNPACKED = 1 << 31  # bytes


def read_whole(path: Path) -> np.ndarray:
    """Return the bytes of a file."""
    return np.frombuffer(path.read_bytes(), np.uint8)


def refuse(path: Path) -> np.ndarray:
    """Refuse a file in two lines."""
    raise ValueError(f"{path}: expected this,\nfound that")


def abort(path: Path) -> np.ndarray:
    """End the process."""
    os.abort()


def unpack(path: Path) -> np.ndarray:
    """Ask for more memory than allowed."""
    return np.ones(UNPACKED, np.uint8)


def wait(path: Path) -> np.ndarray:
    """Never return."""
    time.sleep(60.0)
    return np.zeros(0)
