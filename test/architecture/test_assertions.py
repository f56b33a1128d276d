"""A test can fail: it asserts something by itself, or by a function of the tests that it calls."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

from architecture.tree import ROOT

pytestmark = pytest.mark.slow  # of the checks: `make check`

TESTS = sorted(path.relative_to(ROOT) for path in (ROOT / "test").rglob("*.py"))
ASSERTIONS = {"raises", "warns", "fail"}  # of pytest
PLAIN = re.compile(r"^ *assert\b|\b(raises|warns|fail)\(|\bassert_", re.MULTILINE)


@cache
def nodes(path: Path) -> list[ast.AST]:
    return list(ast.walk(ast.parse((ROOT / path).read_text(encoding="utf-8"))))


@cache
def functions(path: Path) -> dict[str, ast.FunctionDef]:
    return {node.name: node for node in nodes(path) if isinstance(node, ast.FunctionDef)}


@cache
def origins(path: Path) -> dict[str, Path]:
    """Return the file of each name that one imports from another file of the tests."""
    found = {}
    for node in nodes(path):
        if isinstance(node, ast.ImportFrom):
            file = Path("test", *str(node.module).split(".")).with_suffix(".py")
            found |= {item.name: file for item in node.names if (ROOT / file).is_file()}
    return found


def asserts(path: Path, function: ast.FunctionDef, trail: tuple[str, ...] = ()) -> bool:
    """Whether a function of a file asserts something, or calls one that does, of this file or imported by it."""
    called = set()
    for node in ast.walk(function):
        if isinstance(node, ast.Assert):
            return True
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name | ast.Attribute):
            called.add(node.func.id if isinstance(node.func, ast.Name) else node.func.attr)
    if called & ASSERTIONS or any(name.startswith("assert_") for name in called):
        return True
    for name in called - {*trail, function.name}:
        file = origins(path).get(name, path)
        if name in functions(file) and asserts(file, functions(file)[name], (*trail, function.name)):
            return True
    return False


def may_lack(text: str) -> bool:
    """Whether a test of a file has no assertion of its own by its text: to parse all files takes seconds."""
    parts = re.split(r"^ *(?=def |class |@)", text, flags=re.MULTILINE)
    return any(part.startswith("def test_") and not PLAIN.search(part) for part in parts)


def test_every_test_asserts_something() -> None:
    files = [path for path in TESTS if may_lack((ROOT / path).read_text(encoding="utf-8"))]
    tests = [(path, item) for path in files for name, item in functions(path).items() if name.startswith("test_")]
    assert [f"{path}: {item.name}" for path, item in tests if not asserts(path, item)] == []
