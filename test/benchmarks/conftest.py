"""Lets these tests import `benchmarks`, which is not installed, from the checkout, and nothing else of the checkout."""

import importlib.util
import sys

from architecture.tree import ROOT

spec = importlib.util.spec_from_file_location("benchmarks", ROOT / "benchmarks" / "__init__.py")
assert spec is not None
sys.modules["benchmarks"] = importlib.util.module_from_spec(spec)
