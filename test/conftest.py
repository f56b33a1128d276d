"""What every test shares: the installed packages, numba's cache, a ROS domain, seeded generators, recorded data."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import shutil
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest

from architecture.tree import ROOT, differences

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


def import_benchmarks() -> None:
    """Let tests import `benchmarks`, which is not installed, from the checkout, and nothing else of the checkout."""
    folder = ROOT / "benchmarks"
    spec = importlib.util.spec_from_file_location("benchmarks", folder / "__init__.py")
    assert spec is not None
    sys.modules["benchmarks"] = importlib.util.module_from_spec(spec)


# What is tested is what is installed: the checkout leaves the path, here and in every process that a test starts.
sys.path[:] = [entry for entry in sys.path if Path(entry).resolve() != ROOT]
import_benchmarks()

# All of it before numba or rclpy is imported; the processes that tests start inherit it.
_log_folder = tempfile.TemporaryDirectory(prefix="sphere_nav_test_log_")
os.environ |= {
    "PYTHONSAFEPATH": "1",
    "NUMBA_CACHE_DIR": str(kernel_cache()),
    "MPLBACKEND": "Agg",
    "ROS_LOG_DIR": _log_folder.name,
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    "ROS_DOMAIN_ID": str(1 + os.getpid() % 100),  # 0 is everybody's; above 101 the ports are not reserved
}


def pytest_configure() -> None:
    """Refuse to test an installation that is not the checkout's."""
    if different := differences():
        more = f" and {len(different) - 1} more" if len(different) > 1 else ""
        pytest.exit(
            f"{different[0]}{more}: not as in the checkout; `make test` or `make env` installs it", returncode=2
        )


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
