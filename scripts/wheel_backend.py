"""Builds the wheel for pip and pipx: what setuptools makes, and in it the interface packages, which have no wheels.

`pip install .` alone thus gives a `sphere_nav` that runs. `--config-settings=messages=no` leaves them out, where they
are built beside it (`make env`).
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from setuptools import build_meta
from setuptools.build_meta import build_sdist, get_requires_for_build_sdist

__all__ = ["build_sdist", "build_wheel", "get_requires_for_build_sdist", "get_requires_for_build_wheel"]
INTERFACES = ("cmake/tf2_msgs", "msg_defs")
TREE = Path("build/messages")  # setup.py looks here

Settings = dict[str, Any] | None


def get_requires_for_build_wheel(config_settings: Settings = None) -> list[str]:
    """Return what builds the interface packages: all of requirements.txt up to what only runs."""
    if _is_without_messages(config_settings):
        return []
    text = Path("requirements.txt").read_text(encoding="utf-8").partition("# numbers and images")[0]
    return ["numpy", *(line for line in text.splitlines() if line and not line.startswith("#"))]


def build_wheel(wheel_directory: str, config_settings: Settings = None, metadata_directory: str | None = None) -> str:
    """Build the wheel into a folder; return its name."""
    for folder in (TREE, Path("build/lib")):  # what is gone from the tree
        shutil.rmtree(folder, ignore_errors=True)
    try:
        if not _is_without_messages(config_settings):
            _build_messages()
        return str(build_meta.build_wheel(wheel_directory, None, metadata_directory))
    finally:
        shutil.rmtree(TREE, ignore_errors=True)  # colcon's wheel is without


def _is_without_messages(config_settings: Settings) -> bool:
    return (config_settings or {}).get("messages") == "no"


def _build_messages() -> None:
    """Install the interface packages into `TREE`, as below a prefix."""
    generator = find_spec("rosidl_generator_py")
    if generator is None or generator.origin is None:
        raise ModuleNotFoundError("rosidl_generator_py: expected the wheels of requirements.txt (without isolation)")
    prefix = Path(generator.origin).parents[4]  # lib/pythonX.Y/site-packages/NAME/__init__.py
    installed = TREE.absolute() / "installed"
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"
    environment = os.environ | {"DESTDIR": str(installed), "PATH": path}
    for folder in INTERFACES:
        subprocess.run(["scripts/build_interfaces.sh", folder, str(prefix)], env=environment, check=True)
    for part in ("lib", "share"):
        shutil.move(f"{installed}{prefix}/{part}", TREE / part)
    shutil.rmtree(installed)
