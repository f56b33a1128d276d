"""What is imported is declared: requirements*.txt for wheels, package.xml for rosdep, docs/dependencies.md to read."""

import ast
import re
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from architecture.test_layering import ROS
from architecture.tree import EXECUTABLES, MODULES, PACKAGES, ROOT, imports

pytestmark = pytest.mark.slow  # of the checks: `make check`

# import name -> wheel, key of rosdep
THIRD_PARTY = {
    "cv2": ("opencv-python-headless", "python3-opencv"),
    "embreex": ("embreex", "python3-embreex-pip"),
    "gtsam": ("gtsam", "python3-gtsam-pip"),
    "laspy": ("laspy", "python3-laspy-pip"),
    "matplotlib": ("matplotlib", "python3-matplotlib"),
    "mcap": ("mcap", "python3-mcap-pip"),
    "numba": ("numba", "python3-numba"),
    "numpy": ("numpy", "python3-numpy"),
    "pyproj": ("pyproj", "python3-pyproj"),
    "rosbags": ("rosbags", "python3-rosbags-pip"),
    "scipy": ("scipy", "python3-scipy"),
    "tqdm": ("tqdm", "python3-tqdm"),
    "yaml": ("pyyaml", "python3-yaml"),
    "lz4": ("lz4", "python3-lz4"),
    "zstandard": ("zstandard", "python3-zstandard"),
}
# imported where it is used, which says what to install; no part of the ROS package
OPTIONAL = {"distributed", "pye57", "viser", "websockets"}
KNOWN_TO_ROS = ROS | {"ament_index_python", "launch", "launch_ros"}


def imported() -> set[str]:
    names = {name.split(".")[0] for module in MODULES for name in imports(module)}
    return names - set(PACKAGES) - set(sys.stdlib_module_names)


INSTALLERS = {"pip", "uv"}  # in no list: they come first


def wheels(file: str = "requirements.txt") -> set[str]:
    lines = (ROOT / file).read_text(encoding="utf-8").splitlines()
    return {re.split(r"[\[=<>]", line)[0] for line in lines if line and not line.startswith("#")}


def manifest_keys(manifest: Path) -> set[str]:
    return {str(item.text) for item in ET.parse(manifest).getroot() if item.tag.endswith("depend")}


@pytest.mark.slow
def test_every_import_is_known() -> None:
    assert imported() - set(THIRD_PARTY) - KNOWN_TO_ROS == OPTIONAL
    at_load = {name.split(".")[0] for module in MODULES for name in imports(module, is_at_load=True)}
    assert at_load & OPTIONAL == set()


def test_every_wheel_is_pinned() -> None:
    pins = (ROOT / "constraints.txt").read_text(encoding="utf-8").lower().replace("_", "-")
    named = wheels() | wheels("requirements-test.txt") | INSTALLERS
    assert {name for name in named if f"\n{name.lower().replace('_', '-')}==" not in pins} == set()


def test_a_wheel_that_only_tests_need_is_not_in_the_environment() -> None:
    assert wheels() & wheels("requirements-test.txt") == set()


def test_wheels_manifest_and_page_agree() -> None:
    keys, page = manifest_keys(ROOT / "package.xml"), (ROOT / "docs" / "dependencies.md").read_text(encoding="utf-8")
    for wheel, key in THIRD_PARTY.values():
        assert wheel in wheels()
        assert key in keys
        assert f"`{wheel}`" in page
        assert f"`{key}`" in page


@pytest.mark.slow
def test_every_ros_package_in_use_is_in_the_manifest() -> None:
    assert imported() & KNOWN_TO_ROS <= manifest_keys(ROOT / "package.xml")


def test_every_executable_has_its_main() -> None:
    for module in EXECUTABLES.values():
        path = ROOT / (module.replace(".", "/") + ".py")
        body = ast.parse(path.read_text(encoding="utf-8")).body
        assert "main" in [item.name for item in body if isinstance(item, ast.FunctionDef)], f"{module}: no main()"
