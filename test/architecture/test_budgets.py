"""Small pieces: functions without their docstring, pages to read first, folders."""

import ast
from collections import Counter
from pathlib import Path

import pytest

from architecture.tree import MODULES, ROOT, parse

pytestmark = pytest.mark.slow  # of the checks: `make check`

MAX_PAGE, MAX_LAUNCH = 150, 80  # a page: what must be read in one go
MAX_FOLDER = 20  # files
MAX_FUNCTION, MAX_KERNEL = 40, 60
READ_FIRST = {"mapper.py", "localizer.py", "filter.py", "follower.py"}

Function = ast.FunctionDef | ast.AsyncFunctionDef


def num_lines(module: Path) -> int:
    return len((ROOT / module).read_text(encoding="utf-8").splitlines())


def body_lines(function: Function) -> int:
    """Lines from `def` to the end, without the docstring."""
    first = function.body[0]
    has_docstring = ast.get_docstring(function, clean=False) is not None
    docstring = (first.end_lineno or first.lineno) - first.lineno + 1 if has_docstring else 0
    return (function.end_lineno or function.lineno) - function.lineno + 1 - docstring


def test_what_is_read_first_is_a_page() -> None:
    pages = [module for module in MODULES if len(module.parts) == 2 and module.name in READ_FIRST]
    assert [f"{module}: {n}" for module in pages if (n := num_lines(module)) > MAX_PAGE] == []


def test_folders_are_small() -> None:
    counts = Counter(module.parent for module in MODULES)
    assert {str(folder): n for folder, n in counts.items() if n > MAX_FOLDER} == {}


@pytest.mark.slow
def test_functions_are_short() -> None:
    long = []
    for module in MODULES:
        limit = MAX_KERNEL if module.name == "kernels.py" else MAX_FUNCTION
        functions = [node for node in ast.walk(parse(module)) if isinstance(node, Function)]
        long += [f"{module}: {function.name} {n}" for function in functions if (n := body_lines(function)) > limit]
    assert long == []
