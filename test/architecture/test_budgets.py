"""Small pieces: lines of a module, and of a function without its docstring."""

from __future__ import annotations

import ast
from pathlib import Path

from architecture.tree import MODULES, ROOT, is_node, parse

MAX_MODULE, MAX_PAGE, MAX_LAUNCH = 300, 150, 80  # a page: what must be read in one go
MAX_KERNELS = 800  # numba's cache does not follow calls to another file, so kernels.py cannot be cut at will
MAX_FUNCTION, MAX_KERNEL = 40, 60
READ_FIRST = {"mapper.py", "localizer.py", "filter.py", "follower.py"}
LAUNCH_FILES = sorted(path.relative_to(ROOT) for path in (ROOT / "launch").glob("*.launch.py"))

Function = ast.FunctionDef | ast.AsyncFunctionDef


def num_lines(module: Path) -> int:
    return len((ROOT / module).read_text(encoding="utf-8").splitlines())


def body_lines(function: Function) -> int:
    """Lines from `def` to the end, without the docstring."""
    first = function.body[0]
    has_docstring = ast.get_docstring(function, clean=False) is not None
    docstring = (first.end_lineno or first.lineno) - first.lineno + 1 if has_docstring else 0
    return (function.end_lineno or function.lineno) - function.lineno + 1 - docstring


def max_lines(module: Path) -> int:
    is_page = is_node(module) or module.name in READ_FIRST
    return MAX_PAGE if is_page else MAX_KERNELS if module.name == "kernels.py" else MAX_MODULE


def test_modules_are_short() -> None:
    assert [f"{module}: {n}" for module in MODULES if (n := num_lines(module)) > max_lines(module)] == []


def test_functions_are_short() -> None:
    long = []
    for module in MODULES:
        limit = MAX_KERNEL if module.name == "kernels.py" else MAX_FUNCTION
        functions = [node for node in ast.walk(parse(module)) if isinstance(node, Function)]
        long += [f"{module}: {function.name} {n}" for function in functions if (n := body_lines(function)) > limit]
    assert long == []


def test_launch_files_are_short() -> None:
    assert [f"{file}: {n}" for file in LAUNCH_FILES if (n := num_lines(file)) > MAX_LAUNCH] == []
