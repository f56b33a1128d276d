"""Tests mirror the tree: `a/b.py` is tested by `test/a/test_b.py`, or by a test of its package that imports it."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

from architecture.tree import MODULES, ROOT, dotted, room

TESTED_ELSEWHERE = {
    "params.py": "test/architecture/test_params.py",  # declarations only, the same laws for all packages
    "__init__.py": "test/architecture/test_layering.py",  # an index, executed by every import of the package
}


def mirror(module: Path) -> Path:
    """Return where the test of a module lies."""
    if module.name == "node.py" and module.parts[-2] == "ros":
        return Path("test/nodes") / f"test_{module.parts[0]}.py"
    return Path("test") / module.parent / f"test_{module.stem.strip('_')}.py"


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
    expected = Path(TESTED_ELSEWHERE.get(module.name, mirror(module)))
    name = dotted(module)
    return (ROOT / expected).is_file() or name in imported_by_tests(room(name))


def test_modules_have_their_test() -> None:
    """Either the file that mirrors a module, or a test of its package that imports it."""
    assert [f"{module}: no {mirror(module)}" for module in MODULES if not is_tested(module)] == []
