"""Every executable explains itself from anywhere, in an empty environment; so does a command of `sphere_nav`."""

import os
import shutil
import subprocess
import sysconfig
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from architecture.tree import EXECUTABLES

pytestmark = pytest.mark.dds

SCRIPTS = Path(sysconfig.get_path("scripts"))
LINES = [[name] for name in EXECUTABLES] + [["sphere_nav", "map"]]


def explain(words: list[str]) -> str:
    """Return what is wrong with the help of an executable."""
    line = [str(shutil.which("env")), "-i", str(SCRIPTS / words[0]), *words[1:], "--help"]
    done = subprocess.run(line, cwd="/", capture_output=True, text=True, timeout=300, check=False)
    is_good = (done.returncode, done.stderr, words[-1] in done.stdout) == (0, "", True)
    return "" if is_good else f"{words}: {done.returncode} {done.stderr}"


def test_an_executable_explains_itself_in_an_empty_environment() -> None:
    if not (SCRIPTS / "sphere_nav").is_file():  # colcon installs them into lib/sphere_nav, of a prefix
        pytest.skip(f"no executables in {SCRIPTS}")
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        assert [text for text in pool.map(explain, LINES) if text] == []
