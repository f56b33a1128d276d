"""The project's own modules, as the architecture tests see them."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = (
    "typed_params",
    "sphere_geometry",
    "sphere_map",
    "photometric",
    "localization",
    "rig_calibration",
    "sphere_mapping",
    "dense_localizer",
    "mcl_depth",
    "path_follower",
    "cycab_sim",
    "node_kit",
    "sphere_nav_cli",
)
MODULES = sorted(path.relative_to(ROOT) for name in PACKAGES for path in (ROOT / name).rglob("*.py"))


@cache
def parse(module: Path) -> ast.Module:
    """Return the syntax tree of a module given by its path below the root."""
    return ast.parse((ROOT / module).read_text(encoding="utf-8"))


def imports(module: Path) -> Iterator[str]:
    """Yield the dotted name of everything a module imports, `from a.b import c` as `a.b.c`."""
    for node in ast.walk(parse(module)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}:{node.lineno}: relative import"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def is_node(module: Path) -> bool:
    """Whether a module is the ROS shell of its package."""
    return module.name.endswith("node.py") and module.parts[0] != "node_kit"
