"""Faults put into the code: each kind, what is left alone, the sample, which tests, what counts as noticed."""

import ast
import random
import sys
from pathlib import Path

import pytest

from architecture.tree import ROOT

sys.path.append(str(ROOT / "scripts"))  # not installed

from mutants import Mutant, Stage, draw, mutants_of, near_and_other_tests


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


def test_a_fault_that_no_test_could_notice_is_not_made():
    for text in [
        '"""a - b < 3"""',
        "@dataclass(order=True)\nclass A(B, metaclass=g(a, b)): ...",
        "raise ValueError(f(a, b) - 1)",
        "log.warning(a - b, c)",
        "parser.add_argument('-a', b, default=-1)",
        "if TYPE_CHECKING:\n    y = -x",
        "y = np.cumsum(x, axis=-1)",
    ]:
        assert changed(text) == []


def test_nothing_but_the_fault_changes():
    text = 'é = "größer"\nπ = [\n    a   -  b,  # ä - ö\n]\n'
    assert changed(text, "sign") == [text.replace("a   -  b", "a   +  b")]
    (mutant,) = mutants_of(text.encode(), "a.py")
    assert mutant.describe(text.encode()) == "a.py:3  sign: '-' -> '+'"


def test_a_sample_takes_the_kinds_in_turn_and_begins_with_the_smaller_one():
    mutants = mutants_of(b"y = f(a < b, -c, d < e, g < h, i < j)", "a.py")
    sample = draw(mutants, 6, random.Random("1 a"))
    assert sorted(mutant.kind for mutant in sample[:3]) == ["bound", "sign", "swap"]
    assert draw(mutants, 4, random.Random("1 a")) == sample[:4]
    assert draw(mutants, 6, random.Random("2 a")) != sample
    assert sorted(draw(mutants, 99, random.Random("1 a")), key=str) == sorted(mutants, key=str)


FILES = {
    "setup.py": 'PACKAGES = ("sphere_nav", "car")\nEXECUTABLES = {"car_driver": "car.ros.driver"}\n',
    "sphere_nav/__init__.py": "",
    "sphere_nav/geometry/__init__.py": "from sphere_nav.geometry.angles import turn\n",
    "sphere_nav/geometry/angles.py": "def turn(a, b):\n    return a - b\n",
    "sphere_nav/geometry/kernels.py": "y = -1\n",
    "car/__init__.py": "from car.law import steer\n",
    "car/law.py": "from sphere_nav.geometry import turn\n\n\n"
    "def steer(a, b):\n    return max(turn(a, b), 0) if a > 0 else b\n",
    "car/follower.py": "from car import steer\n\n\ndef follow(a):\n    return steer(a, 1)\n",
    "car/ros/driver.py": "from car.follower import follow\n\ny = -1\n",
    "test/sphere_nav/geometry/test_angles.py": "from sphere_nav import geometry\n",
    "test/sphere_nav/geometry/test_far.py": "",
    "test/car/conftest.py": "",
    "test/car/test_a_page.py": "",
    "test/car/test_follower.py": "from car.follower import follow\n\n\ndef test_it():\n    assert follow(4) == 3\n",
    "test/car/test_law.py": "",
    "test/car/test_steering.py": "from car import steer\n\n\ndef test_it():\n    assert steer(4, 1) == 3\n",
    "test/car/test_wrong.py": "from car import law\n\n\ndef test_it():\n    assert False\n",
    "test/nodes/test_car_driver_speed.py": "from car.ros import driver\n",
    "test/nodes/test_other.py": "from car.ros.driver import y\n",
    "test/config/test_yaml_matches_params.py": "",
}


@pytest.fixture
def project(tmp_path):
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def test_tests_that_mirror_or_import_a_module_run_first(project):
    near, rest = near_and_other_tests(project, Path("car/law.py"))
    assert near == [f"test/car/test_{name}.py" for name in ("law", "wrong")]
    others = [f"test/car/test_{name}.py" for name in ("a_page", "follower", "steering")]
    assert rest == [*others, "test/nodes/test_car_driver_speed.py"]
    near, _ = near_and_other_tests(project, Path("sphere_nav/geometry/params.py"))
    assert near == ["test/config/test_yaml_matches_params.py"]
    near, _ = near_and_other_tests(project, Path("car/ros/driver.py"))
    assert near == [f"test/nodes/test_{name}.py" for name in ("car_driver_speed", "other")]
    near, rest = near_and_other_tests(project, Path("sphere_nav/geometry/angles.py"))
    assert (near, rest) == (["test/sphere_nav/geometry/test_angles.py"], ["test/sphere_nav/geometry/test_far.py"])


class Scripted(Stage):
    """A stage whose runs end as they are told: with the mutant, then without it, and so on."""

    def __init__(self, folder, outcomes):
        self.folder, self.broken, self.outcomes = folder, set(), iter(outcomes)
        for place in ("checkout", "site"):
            (folder / place).mkdir()
            (folder / place / "a.py").write_bytes(b"x = a - b\n")

    def run(self, tests, limit_s):
        return next(self.outcomes)


KILLED, LATE, PASSED = ("killed", "t.py::a[1]"), ("timed out", "t.py::b"), ("survived", "")


@pytest.mark.parametrize(
    ("outcomes", "expected"),
    [
        ([PASSED], PASSED),
        ([KILLED, KILLED, PASSED], KILLED),  # it passes without the mutant
        ([KILLED, PASSED, PASSED], PASSED),  # it was slow at first
        ([KILLED, KILLED, KILLED, PASSED], PASSED),  # it fails without it, too, and the others pass
        ([KILLED, KILLED, KILLED, LATE, LATE, PASSED], LATE),
        ([LATE, LATE, LATE, PASSED], PASSED),
        ([("killed", ""), PASSED], ("killed", "")),  # nothing can be imported
    ],
)
def test_a_fault_is_noticed_only_by_a_test_that_passes_without_it(tmp_path, outcomes, expected):
    stage = Scripted(tmp_path, outcomes)
    assert stage.judge(Mutant("a.py", 1, "sign", 6, 7, "+"), ["t.py"], 60.0) == expected
    assert (tmp_path / "site" / "a.py").read_bytes() == b"x = a - b\n"
