"""Tests mirror the tree: `a/b.py` is tested by `test/a/test_b.py`, or by a test of its package that imports it."""

import ast
from functools import cache
from pathlib import Path

import pytest

from architecture.tree import EXECUTABLES, MODULES, ROOT, dotted, room

pytestmark = pytest.mark.slow

TESTED_ELSEWHERE = {
    # declarations only, the same laws for all packages; defaults: test/config/test_yaml_matches_params.py
    "params.py": "test/architecture/test_params.py",
    "constants.py": "test/architecture/test_constants.py",  # judged by the tests of what uses them
    "arrays.py": "test/architecture/test_layering.py",  # what mypy checks
    "__init__.py": "test/architecture/test_layering.py",  # an index, executed by every import of the package
}
COMMANDS = {"sphere_nav_tools.offline": "sphere_nav_tools.cli"}  # what the commands do is tested through them, too
NODES = {module: name for name, module in EXECUTABLES.items()}


def mirrors(module: Path) -> list[Path]:
    """Return where the test of a module may lie; that of a node is named like its executable or its package."""
    names = [NODES[dotted(module)], module.parts[0]] if dotted(module) in NODES else []
    nodes = [Path("test/nodes") / f"test_{name}.py" for name in names]
    return [Path("test") / module.parent / f"test_{module.stem.strip('_')}.py", *nodes]


@cache
def imported_by_tests(package: str) -> set[str]:
    """Return the dotted names that the tests of a package import."""
    names: set[str] = set()
    for path in (ROOT / "test" / package.replace(".", "/")).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                names |= {str(node.module)} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def is_tested(module: Path) -> bool:
    given = TESTED_ELSEWHERE.get(module.name)
    files = [Path(given)] if given else mirrors(module)
    name = dotted(module)
    rooms = {room(name), COMMANDS.get(room(name), room(name))}
    return any((ROOT / file).is_file() for file in files) or any(name in imported_by_tests(item) for item in rooms)


def test_modules_have_their_test() -> None:
    """Either the file that mirrors a module, or a test of its package that imports it."""
    assert [f"{module}: no {mirrors(module)[0]}" for module in MODULES if not is_tested(module)] == []
