"""The numbers of a package stand with the tests that notice a change; those write them out rather than import them."""

from __future__ import annotations

import re

from architecture.tree import MODULES, ROOT

FILES = [module for module in MODULES if module.name == "constants.py"]


def test_the_tests_that_are_named_exist() -> None:
    tests = [f"/{path.relative_to(ROOT).with_suffix('')}" for path in (ROOT / "test").rglob("test_*.py")]
    wrong = []
    for module in FILES:
        names = re.findall(r"\b(?:\w+/)*test_\w+", (ROOT / module).read_text(encoding="utf-8")) or ["any"]
        wrong += [f"{module}: {name}" for name in names if not any(test.endswith(f"/{name}") for test in tests)]
    assert len(FILES) > 8
    assert wrong == []
