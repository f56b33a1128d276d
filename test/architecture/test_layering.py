"""Imports go one way: this table is the architecture."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from architecture.tree import MODULES, PACKAGES, imports, is_node

GEOMETRY = {"typed_params", "sphere_geometry"}
COMPILED = GEOMETRY | {"kernel_cache"}
MAY_IMPORT: dict[str, set[str]] = {
    "typed_params": set(),
    "kernel_cache": set(),
    "sphere_geometry": {"typed_params"},
    "sphere_map": GEOMETRY,
    "photometric": COMPILED,
    "view_synthesis": COMPILED | {"photometric", "sphere_map"},
    "localization": GEOMETRY,
    "rig_calibration": GEOMETRY | {"photometric"},
    "sphere_mapping": COMPILED | {"photometric", "sphere_map", "view_synthesis"},
    "dense_localizer": GEOMETRY | {"localization", "photometric", "sphere_map"},
    "mcl_depth": COMPILED | {"localization"},
    "path_follower": GEOMETRY,
    "command_guard": {"typed_params"},
    "cycab_sim": COMPILED,
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


def found_in(modules: Iterable[Path], is_offence: Callable[[Path, str], bool]) -> list[str]:
    """Return what is imported against the rules, as `module: name`."""
    return [f"{module}: {name}" for module in modules for name in imports(module) if is_offence(module, name)]


def test_the_table_holds_every_package() -> None:
    assert set(MAY_IMPORT) == set(PACKAGES)


def test_modules_import_only_what_lies_below_them() -> None:
    def is_upward(module: Path, name: str) -> bool:
        package = module.parts[0]
        allowed = MAY_IMPORT[package] | {package} | ({"node_kit"} if is_node(module) else set())
        return name.split(".")[0] in PACKAGES and not is_allowed(name, allowed)

    assert found_in(MODULES, is_upward) == []


def test_ros_stays_in_the_shell() -> None:
    algorithms = [
        module for module in MODULES if not is_node(module) and module.parts[0] not in ("node_kit", "sphere_nav_cli")
    ]
    assert found_in(algorithms, lambda _, name: name.split(".")[0] in ROS) == []


def test_numba_stays_in_the_kernels() -> None:
    others = [module for module in MODULES if module.name != "kernels.py"]
    assert found_in(others, lambda _, name: name.split(".")[0] == "numba") == []


def test_no_import_runs_in_a_circle() -> None:
    """When modules are loaded; an import within a function comes later."""
    names = {".".join(module.with_suffix("").parts).removesuffix(".__init__"): module for module in MODULES}
    graph = {name: imported_modules(name, module, names) for name, module in names.items()}
    while ends := {name for name, below in graph.items() if not below or not any(name in it for it in graph.values())}:
        graph = {name: below - ends for name, below in graph.items() if name not in ends}
    assert {name: sorted(below) for name, below in graph.items()} == {}


def imported_modules(name: str, module: Path, names: dict[str, Path]) -> set[str]:
    """Return the modules of the project that a module imports; not the packages it lies in, which index it."""
    below = {found if found in names else found.rpartition(".")[0] for found in imports(module, is_at_load=True)}
    return {found for found in below if found in names and not name.startswith(f"{found}.") and found != name}


def test_no_guard_hides_an_import() -> None:
    assert found_in(MODULES, lambda _, name: name == "typing.TYPE_CHECKING") == []
