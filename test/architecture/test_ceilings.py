"""No package grows above its ceilings in scripts/ceilings.toml: raising one is a commit of its own."""

import sys
import tomllib

import pytest

from architecture.tree import ROOT

sys.path.append(str(ROOT / "scripts"))  # not installed

import sizes

pytestmark = pytest.mark.slow  # of the checks: `make check`


def test_no_package_is_above_its_ceilings():
    found = sizes.sizes()
    assert found["product"]["nodes"] > 0
    assert sizes.find_excesses(found, tomllib.loads(sizes.CEILINGS.read_text(encoding="utf-8"))) == []


def test_what_is_above_or_has_none_is_told():
    found = {"a": sizes.Counter(nodes=5), "b": sizes.Counter(files=1)}
    ceilings = {"a": {"nodes": 4}}
    expected = ["a: nodes: expected at most 4, found 5", "b: files: expected at most 0, found 1"]
    assert sizes.find_excesses(found, ceilings) == expected
    assert sizes.find_excesses(found, {"a": {"nodes": 5}, "b": {"files": 1}}) == []


def test_what_a_reader_carries_is_not_changed_by_remarks():
    plain = sizes.measure(
        "import a\nGATE, _B = 1.5, 2\n\n\ndef f(x: int = param(3)) -> int:\n    return x and 1 or a\n"
    )
    told = sizes.measure(
        '"""What."""\nimport a, b\n\nGATE, _B = 1.5, 2  # m\n\n\ndef f(x: int = param(3)) -> int:\n    """Do."""\n'
        "    return x and 1 or a\n"
    )
    for one in (plain, told):
        one.pop("lines")
    assert plain == told
    counted = {what: plain[what] for what in ("branches", "names", "constants", "parameters", "files")}
    assert counted == {"branches": 2, "names": 2, "constants": 2, "parameters": 1, "files": 1}
