"""Faults put into the code: each kind, what is left alone, and how it is told."""

import ast
import sys

from architecture.tree import ROOT

sys.path.append(str(ROOT / "scripts"))  # not installed

from mutants import mutants_of


def changed(text, kind=None):
    """The texts that a text becomes, by one kind of fault or all."""
    found = [mutant for mutant in mutants_of(text.encode(), "a.py") if kind in (None, mutant.kind)]
    texts = [mutant.apply(text.encode()).decode() for mutant in found]
    for item in texts:
        assert ast.dump(ast.parse(item)) != ast.dump(ast.parse(text))
    return texts


FAULTS = [
    ("sign", "y = -x", ["y = x"]),
    ("sign", "y = a * b", ["y = -a * b"]),
    ("sign", "y = (a) + (  # why\n b)", []),
    ("sign", "y = 'a' + b\nz = [c] * n", []),
    ("bound", "y = a < b", ["y = a <= b", "y = a > b"]),
    ("bound", "y = a < b >= c", ["y = a <= b >= c", "y = a > b >= c", "y = a < b > c", "y = a < b <= c"]),
    ("unit", "y = 0.5 * x", ["y = (0.5 * 1000) * x"]),
    ("unit", "y = 2 * x ** 0.5", []),
    ("unit", "y = math.radians(a + 1)", ["y = (a + 1)"]),
    ("swap", "f(a, b, c)", ["f(b, a, c)", "f(a, c, b)"]),
    ("swap", "f(a, a, *b)", []),
    ("swap", "max(a, b)\nisinstance(a, b)\nf('text', a)\nparam(a, b)\nf(lambda: 1, a)", []),
    ("check", "def f(a):\n    if (a and\n  b):\n        raise ValueError(a < 1)", ["if (False):"]),
    ("check", "if a:\n    n = 1", []),
    ("constant", "LIMITS: dict[str, float] = {'a': 0.25, 'b': 0}", ["LIMITS: dict[str, float] = {'a': 0.5, 'b': 0}"]),
    ("constant", "class A:\n    x: int = param(3, 'm', low=1)", ["class A:\n    x: int = param(6, 'm', low=1)"]),
    ("constant", "def f(a=1.0, *, b=True): ...", ["def f(a=2.0, *, b=True): ..."]),
    ("constant", "y = 3", []),
    ("boolean", "y = a or (b) or c", ["y = a and (b) or c", "y = a or (b) and c"]),
    ("bound", "y = np.nanargmax(a).min()", ["y = np.nanargmax(a).max()", "y = np.nanargmin(a).min()"]),
    ("boolean", "y = not (a)", ["y = (a)"]),
    ("boolean", "y = a is not None", ["y = a is None"]),
]


def test_each_kind_of_fault():
    for kind, text, expected in FAULTS:
        found = changed(text, kind)
        if kind == "check":
            found = [line.strip() for item in found for line in item.splitlines() if "False" in line]
        assert sorted(found) == sorted(expected)


def test_nothing_but_the_fault_changes():
    text = 'é = "größer"\nπ = [\n    a   -  b,  # ä - ö\n]\n'
    assert changed(text, "sign") == [text.replace("a   -  b", "a   +  b")]
    (mutant,) = mutants_of(text.encode(), "a.py")
    assert mutant.describe(text.encode()) == "a.py:3  sign: '-' -> '+'"
