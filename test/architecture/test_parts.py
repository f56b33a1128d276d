"""Small pieces, constants that say what they are, a test for each module, parts that are not given their node."""

import ast
import re
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from architecture.tree import EXECUTABLES, MODULES, ROOT, dotted, imports, parse, room

NODE_BASES = {"ManagedNode", "LocalizerNode"}


def node_parameters(module: Path) -> Iterator[str]:
    """Yield the parameters of classes and functions that a node is given to, by name or by annotation."""
    for item in ast.walk(parse(module)):
        if isinstance(item, ast.FunctionDef):
            arguments = [*item.args.posonlyargs, *item.args.args, *item.args.kwonlyargs]
            for argument in arguments:
                kind = ast.unparse(argument.annotation) if argument.annotation else ""
                if kind in NODE_BASES or (kind.endswith("Node") and kind != "Node"):
                    yield f"{item.name}({argument.arg}: {kind})"


def is_part(module: Path) -> bool:
    """Whether a module is a part of a node; what carries nodes out (`run`, `live`, `replay`) is none."""
    is_carrier = room(dotted(module)) == "sphere_nav.ros" and module.stem in ("run", "live", "replay", "node")
    return room(dotted(module)) not in ("sphere_nav_tools.cli", "sphere_nav_tools.offline") and not is_carrier


@pytest.mark.slow
def test_no_part_is_given_its_node() -> None:
    assert [f"{module}: {text}" for module in filter(is_part, MODULES) for text in node_parameters(module)] == []


@pytest.mark.slow
def test_one_executor_calls_the_callbacks_of_nodes() -> None:
    """Only the guarded executor takes from rclpy's."""
    users = [str(module) for module in MODULES if any(name.endswith("ThreadedExecutor") for name in imports(module))]
    assert users == ["sphere_nav/ros/executor.py"]


MAX_PAGE = 150  # a page: what must be read in one go
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


@pytest.mark.slow
def test_a_file_to_read_first_is_a_page() -> None:
    pages = [module for module in MODULES if len(module.parts) == 2 and module.name in READ_FIRST]
    assert [f"{module}: {n}" for module in pages if (n := num_lines(module)) > MAX_PAGE] == []


@pytest.mark.slow
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


FILES = [module for module in MODULES if module.name == "constants.py"]
TESTS = {path.with_suffix("").as_posix() for path in (ROOT / "test").rglob("test_*.py")}


@pytest.mark.slow
def test_a_constant_names_tests_that_are_there() -> None:
    named = {(module, name) for module in FILES for name in re.findall(r"\b(?:\w+/)*test_\w+", text_of(module))}
    missing = [f"{module}: {name}" for module, name in named if not any(one.endswith("/" + name) for one in TESTS)]
    assert named
    assert sorted(missing) == []


@pytest.mark.slow
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


TESTED_ELSEWHERE = {
    # declarations only, the same laws for all packages; defaults: test/config/test_yaml_matches_params.py
    "params.py": "test/architecture/test_params.py",
    "constants.py": "test/architecture/test_parts.py",  # judged by the tests of what uses them
    "__init__.py": "test/architecture/test_layering.py",  # an index, executed by every import of the package
    "learning.py": "test/sphere_nav_tools/cli/maps/test_map.py",  # what `map` does
    "map_verify.py": "test/sphere_nav_tools/cli/maps/test_map.py",
    "register.py": "test/sphere_nav_tools/cli/maps/test_map.py",
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


@pytest.mark.slow
def test_modules_have_their_test() -> None:
    """Either the file that mirrors a module, or a test of its package that imports it."""
    assert [f"{module}: no {mirrors(module)[0]}" for module in MODULES if not is_tested(module)] == []
