"""Imports go one way: this table is the architecture."""

from collections.abc import Callable, Iterable
from pathlib import Path

import pytest

from architecture.tree import MODULES, PACKAGES, dotted, imports, is_shell, room

pytestmark = pytest.mark.slow  # of the checks: `make check`

L, TOOLS = "sphere_nav.", "sphere_nav_tools."
GEOMETRY = {L + "params", L + "geometry"}
ESTIMATION = GEOMETRY | {L + "estimation", L + "kernel_cache"}
MAPS = ESTIMATION | {L + "spheres"}
MAY_IMPORT: dict[str, set[str]] = {
    L + "params": set(),
    L + "kernel_cache": {L + "params"},
    L + "geometry": {L + "params"},
    L + "estimation": GEOMETRY | {L + "kernel_cache"},
    L + "spheres": ESTIMATION,
    L + "photometric": ESTIMATION,
    L + "view_synthesis": MAPS | {L + "photometric"},
    L + "localization": ESTIMATION,
    L + "ros": MAPS | {L + "localization"},
    "rig_calibration": ESTIMATION | {L + "photometric"},
    "sphere_mapping": MAPS | {L + "photometric", L + "view_synthesis"},
    "dense_localizer": MAPS | {L + "localization", L + "photometric"},
    "mcl_depth": ESTIMATION | {L + "localization", L + "photometric"},
    "path_follower": ESTIMATION | {L + "localization"},
    "cycab_sim": GEOMETRY | {L + "kernel_cache"},
}
MAY_IMPORT[TOOLS + "offline"] = {*MAY_IMPORT}  # the roof: nothing below imports it
MAY_IMPORT[TOOLS + "cli"] = {*MAY_IMPORT}
MAY_IMPORT[TOOLS + "library"] = {*MAY_IMPORT}
FORBIDDEN = {  # within a package
    "sphere_mapping.acquisition": ("sphere_mapping.graph", "sphere_mapping.mapper", "sphere_mapping.ros")
}
ROS = {"rclpy", "ackermann_msgs", "rcl_interfaces", "builtin_interfaces", "diagnostic_msgs", "geometry_msgs"}
ROS |= {"lifecycle_msgs", "nav_msgs", "nav2_msgs", "rosgraph_msgs", "sensor_msgs", "sphere_nav_msgs", "std_msgs"}
ROS |= {"std_srvs", "tf2_msgs", "visualization_msgs"}
WITH_ROS = {L + "ros", TOOLS + "offline", TOOLS + "cli", TOOLS + "library"}


def rooms_below(module: Path) -> set[str]:
    """Return the rooms that a module may import from, its own included."""
    here = room(dotted(module))
    allowed = MAY_IMPORT.get(here, set()) | {here}
    if is_shell(module):
        allowed = allowed | {L + "ros"}
    return allowed


def is_inside(name: str, package: str) -> bool:
    return name == package or name.startswith(package + ".")


def found_in(modules: Iterable[Path], is_offence: Callable[[Path, str], bool]) -> list[str]:
    """Return what is imported against the rules, as `module: name`."""
    return [f"{module}: {name}" for module in modules for name in imports(module) if is_offence(module, name)]


def test_every_room_is_in_the_table() -> None:
    assert set(MAY_IMPORT) == {room(dotted(module)) for module in MODULES} - {"sphere_nav", "sphere_nav_tools"}


@pytest.mark.slow
def test_modules_import_only_what_lies_below_them() -> None:
    def is_upward(module: Path, name: str) -> bool:
        return name.split(".")[0] in PACKAGES and room(name) not in rooms_below(module)

    assert found_in(MODULES, is_upward) == []


@pytest.mark.slow
def test_no_package_imports_what_it_forbids_within_itself() -> None:
    offences = [
        f"{module}: {name}"
        for lower, uppers in FORBIDDEN.items()
        for module in MODULES
        for name in imports(module)
        if is_inside(dotted(module), lower) and any(is_inside(name, upper) for upper in uppers)
    ]
    assert offences == []


@pytest.mark.slow
def test_only_the_shell_imports_the_shell() -> None:
    """An algorithm knows nothing of the folder ros/ of its own package."""

    def is_offence(module: Path, name: str) -> bool:
        is_algorithm = not is_shell(module) and room(dotted(module)) not in WITH_ROS
        return is_algorithm and name.split(".")[0] in PACKAGES and "ros" in name.split(".")[1:-1]

    assert found_in(MODULES, is_offence) == []


def test_ros_stays_in_the_shell() -> None:
    algorithms = [module for module in MODULES if not is_shell(module) and room(dotted(module)) not in WITH_ROS]
    assert found_in(algorithms, lambda _, name: name.split(".")[0] in ROS) == []


@pytest.mark.slow
def test_numba_stays_in_the_kernels() -> None:
    others = [module for module in MODULES if module.name != "kernels.py"]
    assert found_in(others, lambda _, name: name.split(".")[0] == "numba") == []


def test_no_import_runs_in_a_circle() -> None:
    """When modules are loaded; an import within a function comes later."""
    names = {dotted(module): module for module in MODULES}
    graph = {name: imported_modules(name, module, names) for name, module in names.items()}
    while ends := {name for name, below in graph.items() if not below or not any(name in it for it in graph.values())}:
        graph = {name: below - ends for name, below in graph.items() if name not in ends}
    assert {name: sorted(below) for name, below in graph.items()} == {}


def imported_modules(name: str, module: Path, names: dict[str, Path]) -> set[str]:
    """Return the modules of the project that a module imports; not the packages it lies in, which index it."""
    below = {found if found in names else found.rpartition(".")[0] for found in imports(module, is_at_load=True)}
    return {found for found in below if found in names and not name.startswith(f"{found}.") and found != name}


@pytest.mark.slow
def test_no_guard_hides_an_import() -> None:
    assert found_in(MODULES, lambda _, name: name == "typing.TYPE_CHECKING") == []
