"""What every test shares: numba's cache, a ROS domain of its own, seeded generators and recorded data."""

from __future__ import annotations

import hashlib
import os
import shutil
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]
STALE_AFTER_S = 7 * 24 * 3600.0


def kernel_cache() -> Path:
    """Return a cache folder for exactly these kernels.

    numba does not see edits in a jitted callee of another file, so a cache must not outlive any kernel's source;
    compiling anew in every session would take minutes.
    """
    key = hashlib.sha256(sys.version.encode())
    for path in sorted(ROOT.glob("*/**/kernels.py")):
        if "site-packages" not in path.parts and "build" not in path.parts:
            key.update(path.read_bytes())
    base = Path(os.environ.get("NUMBA_CACHE_DIR") or ROOT / ".numba_cache")
    cache = base / f"test_{key.hexdigest()[:16]}"
    cache.mkdir(parents=True, exist_ok=True)
    os.utime(cache)
    for other in base.glob("test_*"):
        if time.time() - other.stat().st_mtime > STALE_AFTER_S:
            shutil.rmtree(other, ignore_errors=True)
    return cache


# All of it before numba or rclpy is imported; the processes that tests start inherit it.
_log_folder = tempfile.TemporaryDirectory(prefix="sphere_nav_test_log_")
os.environ |= {
    "NUMBA_CACHE_DIR": str(kernel_cache()),
    "MPLBACKEND": "Agg",
    "ROS_LOG_DIR": _log_folder.name,
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    "ROS_DOMAIN_ID": str(1 + os.getpid() % 100),  # 0 is everybody's; above 101 the ports are not reserved
}


@pytest.fixture
def rng() -> np.random.Generator:
    """Seeded random numbers."""
    return np.random.default_rng(20150722)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of recorded data beside the project; the test is skipped where it is absent."""
    folder = Path(os.environ.get("SPHERE_NAV_DATA") or ROOT.parent / "shared" / "data")
    if not folder.is_dir():
        pytest.skip(f"recorded data: no folder {folder}; SPHERE_NAV_DATA names another one")
    return folder
