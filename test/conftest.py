"""What every test shares: the installed packages, a ROS domain, seeded generators."""

from __future__ import annotations

import os

# NumPy reads it as it is imported; threads that multiply matrices would wait for each other longer than they compute.
os.environ["OPENBLAS_NUM_THREADS"] = os.environ.get("OPENBLAS_NUM_THREADS", "1")

import faulthandler
import gc
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from architecture.tree import ROOT, differences

END_S = 30.0  # s for what is left of a process of tests


# What is tested is what is installed: the checkout leaves the path, here and in every process that a test starts.
sys.path[:] = [entry for entry in sys.path if Path(entry).resolve() != ROOT]
pytest_plugins = ["rings"]


# All of it before rclpy is imported; the processes that tests start inherit it.
_log_folder = tempfile.TemporaryDirectory(prefix="sphere_nav_test_log_")
os.environ |= {
    "PYTHONSAFEPATH": "1",
    "MPLBACKEND": "Agg",
    "ROS_LOG_DIR": _log_folder.name,
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
}


def pytest_configure() -> None:
    """Refuse to test an installation that is not the checkout's; claim a ROS domain; have Ctrl-C end what tests start.

    A shell has what it starts in the background ignore SIGINT, and so would every process that a test starts.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if different := differences():
        more = f" and {len(different) - 1} more" if len(different) > 1 else ""
        pytest.exit(
            f"{different[0]}{more}: not as in the checkout; `make test` or `make env` installs it", returncode=2
        )
    from sphere_nav_tools.cli.processes import FOR_DRIVES, claim_domain  # it is what is installed, as was seen

    os.environ["ROS_DOMAIN_ID"] = str(claim_domain(range(1, FOR_DRIVES.start)))


def pytest_unconfigure(config: pytest.Config) -> None:
    """Say where a thread is that goes on when all is done, and end the process: it would never end by itself.

    A worker is ended by the process that gave it its tests, when the last worker is done.
    """
    if not hasattr(config, "workerinput"):
        faulthandler.dump_traceback_later(END_S, exit=True)


def pytest_collection() -> None:
    """Look for no garbage while modules are loaded: it would be a third of the time."""
    gc.disable()


def pytest_collection_finish() -> None:
    """Look for garbage again, but not among what was loaded."""
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="session", autouse=True)
def nothing_is_left_in_the_checkout() -> Iterator[None]:
    """Refuse tests that write beside the code: what they make belongs below `tmp_path`."""
    before = visible()
    yield
    assert visible() - before == set()


@pytest.fixture(scope="session", autouse=True)
def libraries_are_ready() -> None:
    """Charge what numba and SciPy load in a process with their first call to no test: which comes first is chance."""
    if "numba" in sys.modules:
        from sphere_nav.estimation.kernels import newton_step

        newton_step(np.eye(6), np.zeros(6), 0)
    if "path_follower.taught" in sys.modules:
        import_module("scipy.signal")


def visible() -> set[str]:
    """Return what stands at the root of the checkout, without what begins with a dot and what Python compiles."""
    return {path.name for path in ROOT.iterdir() if not path.name.startswith((".", "__"))}


@pytest.fixture
def rng() -> np.random.Generator:
    """Seeded random numbers."""
    return np.random.default_rng(20150722)


@pytest.fixture
def spawn() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Start processes whose standard error is read; those that still run are ended."""
    running: list[subprocess.Popen[str]] = []

    def begin(command: list[str], **pipes: int) -> subprocess.Popen[str]:
        running.append(subprocess.Popen(command, text=True, **({"stderr": subprocess.PIPE} | pipes)))
        return running[-1]

    yield begin
    for process in running:
        if process.poll() is None:
            process.kill()
        process.communicate(timeout=600.0)


@pytest.fixture
def domain() -> int:
    """Return the ROS domain of this process of tests, and of what it starts."""
    return int(os.environ["ROS_DOMAIN_ID"])
