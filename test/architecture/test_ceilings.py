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
