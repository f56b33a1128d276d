"""The numbers that results depend on: each says what it is, and the tests that are named with them are there."""

import ast
import re
from pathlib import Path

import pytest

from architecture.tree import MODULES, ROOT

pytestmark = pytest.mark.slow  # of the checks: `make check`

FILES = [module for module in MODULES if module.name == "constants.py"]
TESTS = {path.with_suffix("").as_posix() for path in (ROOT / "test").rglob("test_*.py")}


def test_the_tests_that_constants_name_are_there() -> None:
    named = {(module, name) for module in FILES for name in re.findall(r"\b(?:\w+/)*test_\w+", text_of(module))}
    missing = [f"{module}: {name}" for module, name in named if not any(one.endswith("/" + name) for one in TESTS)]
    assert named
    assert sorted(missing) == []


def test_each_constant_says_what_it_is() -> None:
    """In a comment on its lines, or in a line of its own above it."""
    silent = []
    for module in FILES:
        lines = text_of(module).splitlines()
        for node in ast.parse(text_of(module)).body:
            if isinstance(node, ast.Assign | ast.AnnAssign):
                above, own = lines[node.lineno - 2], lines[node.lineno - 1 : node.end_lineno]
                if not above.startswith("#") and not any("#" in line for line in own):
                    silent.append(f"{module}: {own[0]}")
    assert silent == []


def text_of(module: Path) -> str:
    return (ROOT / module).read_text(encoding="utf-8")
