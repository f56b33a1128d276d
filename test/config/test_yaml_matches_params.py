"""`config/` and `docs/parameters.md` say what the parameters classes say (`make docs` writes them)."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import yaml

from architecture.tree import flatten, for_all
from sphere_nav.params import build, leaves

ROOT = Path(__file__).resolve().parents[2]
SPEC = importlib.util.spec_from_file_location("generate", ROOT / "docs" / "generate.py")
assert SPEC is not None
assert SPEC.loader is not None
generate = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(generate)
FILES = generate.files()
NODES = list(generate.node_classes())
MEASURED = {"cycab"}  # the car's own file, by hand: test/cycab_sim/test_params.py


@for_all(FILES)
def test_a_generated_file_is_up_to_date(path: Path) -> None:
    assert path.is_file(), f"{path}: missing; make docs writes it"
    assert path.read_text(encoding="utf-8") == FILES[path], f"{path}: outdated; make docs writes it"


def test_no_file_is_left_of_a_node_that_is_gone() -> None:
    assert {path.stem for path in (ROOT / "config").glob("*.yaml")} - MEASURED == {node.NAME for node in NODES}


@for_all(NODES)
def test_a_file_loads_into_its_class(node: type) -> None:
    tree = yaml.safe_load((ROOT / "config" / f"{node.NAME}.yaml").read_text(encoding="utf-8"))
    values = flatten(tree["/**"]["ros__parameters"])
    own = {leaf.name: leaf.type for leaf in leaves(node.PARAMS)}
    shared = {leaf.name: leaf.type for leaf in leaves(generate.ShellParams)}
    assert {name: type(value) for name, value in values.items()} == shared | own  # floats written as floats
    assert build(node.PARAMS, {name: values[name] for name in own}) == node.PARAMS()
