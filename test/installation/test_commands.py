"""Every executable and every subcommand explains itself from anywhere, in an empty environment."""

from __future__ import annotations

import shutil
import subprocess
import sysconfig
from pathlib import Path

import pytest

from architecture.tree import EXECUTABLES
from sphere_nav_tools.cli.main import COMMANDS

pytest.importorskip("rclpy", reason="the nodes need ROS 2")

pytestmark = pytest.mark.dds

SCRIPTS = Path(sysconfig.get_path("scripts"))
LINES = [[name] for name in EXECUTABLES] + [["sphere_nav", command.name] for command in COMMANDS]


@pytest.mark.parametrize("words", LINES, ids=" ".join)
def test_help_in_an_empty_environment(words: list[str]) -> None:
    executable = SCRIPTS / words[0]
    if not executable.is_file():  # colcon installs them into lib/sphere_nav, of a prefix that is no environment
        pytest.skip(f"no {executable}")
    env = shutil.which("env")
    line = [str(env), "-i", str(executable), *words[1:], "--help"]
    done = subprocess.run(line, cwd="/", capture_output=True, text=True, timeout=120, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert words[-1] in done.stdout
