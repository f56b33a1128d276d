"""Imports go one way: this table is the architecture."""

from __future__ import annotations

from pathlib import Path

import pytest

from architecture.tree import MODULES, PACKAGES, imports, is_node

GEOMETRY = {"typed_params", "sphere_geometry"}
MAY_IMPORT: dict[str, set[str]] = {
    "typed_params": set(),
    "sphere_geometry": {"typed_params"},
    "sphere_map": GEOMETRY,
    "photometric": GEOMETRY,
    "localization": GEOMETRY,
    "rig_calibration": GEOMETRY,
    "sphere_mapping": GEOMETRY | {"photometric", "sphere_map"},
    "dense_localizer": GEOMETRY | {"localization", "photometric", "sphere_map"},
    "mcl_depth": GEOMETRY | {"localization"},
    "path_follower": GEOMETRY,
    "cycab_sim": GEOMETRY,
    "node_kit": GEOMETRY | {"localization", "sphere_map"},
    "sphere_nav_cli": set(PACKAGES),
}
ROS = {
    "rclpy",
    "ackermann_msgs",
    "rcl_interfaces",
    "builtin_interfaces",
    "diagnostic_msgs",
    "geometry_msgs",
    "lifecycle_msgs",
    "nav_msgs",
    "rosgraph_msgs",
    "sensor_msgs",
    "sphere_nav_msgs",
    "std_msgs",
    "std_srvs",
    "tf2_msgs",
    "visualization_msgs",
}


def is_allowed(name: str, allowed: set[str]) -> bool:
    return any(name == entry or name.startswith(entry + ".") for entry in allowed)


@pytest.mark.parametrize("module", MODULES, ids=str)
def test_a_module_imports_only_what_lies_below_it(module: Path) -> None:
    package = module.parts[0]
    allowed = MAY_IMPORT[package] | {package} | ({"node_kit"} if is_node(module) else set())
    ours = [name for name in imports(module) if name.split(".")[0] in PACKAGES]
    assert [name for name in ours if not is_allowed(name, allowed)] == []


@pytest.mark.parametrize("module", MODULES, ids=str)
def test_ros_stays_in_the_shell(module: Path) -> None:
    if is_node(module) or module.parts[0] in ("node_kit", "sphere_nav_cli"):
        return
    assert [name for name in imports(module) if name.split(".")[0] in ROS] == []


@pytest.mark.parametrize("module", MODULES, ids=str)
def test_numba_stays_in_the_kernels(module: Path) -> None:
    if module.name == "kernels.py":
        return
    assert [name for name in imports(module) if name.split(".")[0] == "numba"] == []
