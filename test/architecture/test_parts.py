"""A part of a node receives values and callbacks, never the node."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from architecture.tree import MODULES, dotted, imports, parse, room

pytestmark = pytest.mark.slow

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


def test_no_part_is_given_its_node() -> None:
    assert [f"{module}: {text}" for module in filter(is_part, MODULES) for text in node_parameters(module)] == []


def test_one_executor_calls_the_callbacks_of_nodes() -> None:
    """Only the guarded executor takes from rclpy's; the demo watches others with one of its own, and is no node."""
    users = [str(module) for module in MODULES if any(name.endswith("ThreadedExecutor") for name in imports(module))]
    assert sorted(users) == ["sphere_nav/ros/executor.py", "sphere_nav_tools/cli/demo/watch.py"]
