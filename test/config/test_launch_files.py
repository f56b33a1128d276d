"""The launch files name executables, parameters and files that exist; `ros2 launch` itself is not in the wheels."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from config.test_yaml_matches_params import NODES, ROOT, generate
from typed_params import leaves

LAUNCH_FILES = sorted((ROOT / "launch").glob("*.launch.py"))
BY_NAME = {node.NAME: node for node in NODES}


def calls(path: Path, name: str) -> Iterator[dict[str, ast.expr]]:
    """Yield the keyword arguments of every call of a function."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == name:
            yield {str(keyword.arg): keyword.value for keyword in node.keywords}


def literals(tree: ast.AST) -> set[Any]:
    return {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)}


def set_parameters(call: dict[str, ast.expr]) -> dict[str, ast.expr]:
    dictionaries = [node for node in ast.walk(call["parameters"]) if isinstance(node, ast.Dict)]
    pairs = [pair for node in dictionaries for pair in zip(node.keys, node.values, strict=True)]
    return {ast.literal_eval(key): value for key, value in pairs if key is not None}


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)
def test_nodes_and_their_parameters_exist(path: Path) -> None:
    found = list(calls(path, "Node"))
    assert found
    for call in found:
        node = BY_NAME[ast.literal_eval(call["executable"])]
        known = {leaf.name for cls in (node.PARAMS, generate.ShellParams) for leaf in leaves(cls)}
        assert set(set_parameters(call)) - known - {"use_sim_time"} == set(), f"{path.name}: {node.NAME}"


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)
def test_arguments_are_declared_and_used(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    table = re.search(r"^ARGUMENTS = {$(.*?)^}$", text, re.DOTALL | re.MULTILINE)
    assert table is not None
    declared = set(re.findall(r'^    "(\w+)": \(', table[1], re.MULTILINE))
    used = set(re.findall(r'(?:values\[|typed\()"(\w+)"', text))
    assert used == declared


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)
def test_files_that_are_named_exist(path: Path) -> None:
    names = {text for text in literals(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(text, str)}
    for name in names:
        if name.endswith(".yaml"):
            assert (ROOT / "config" / name).is_file(), name
        elif name.endswith(".launch.py") and " " not in name:
            assert (ROOT / "launch" / name).is_file(), name
