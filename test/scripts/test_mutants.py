"""Faults put into the code: each kind, what is left alone, the sample, which tests, what counts as noticed."""

import ast
import os
import random
import subprocess
import sys
from dataclasses import asdict
from pathlib import PurePosixPath

import pytest

from architecture.tree import ROOT

sys.path.append(str(ROOT / "scripts"))  # not installed

import mutants
from checkout import Tree, package_of
from mutants import Report, Result, Run, Stage, all_mutants, earlier_results, sample_of
from mutations import KINDS, Mutant, apply, draw, mutants_of, numeric_constants

NAMES = {"LIMIT", "PERIOD_NS"}
MUTANT = Mutant("a/b.py", 3, "sign", "- -> +", "x = a - b", 10, 11, "+")


def changed(text, kind=None, names=NAMES):
    """The texts that a text becomes, by one kind of fault or all."""
    found = [mutant for mutant in mutants_of(text.encode(), "a.py", names) if kind in (None, mutant.kind)]
    texts = [apply(text.encode(), mutant).decode() for mutant in found]
    for item in texts:
        assert ast.dump(ast.parse(item)) != ast.dump(ast.parse(text))
    return texts


FAULTS = [
    ("sign", "y = -x", ["y = x"]),
    ("sign", "y = a * b", ["y = -a * b"]),
    ("sign", "y = (a) + (  # why\n b)", []),
    ("sign", "y = (a) - b", ["y = (a) + b"]),
    ("sign", "y += a", ["y -= a"]),
    ("sign", "y = 'a' + b\nz = [c] * n", []),
    ("bound", "y = a < b", ["y = a <= b", "y = a > b"]),
    ("bound", "y = 0 <= a", ["y = 0 < a", "y = 0 >= a"]),
    ("bound", "y = a == b", []),
    ("bound", "y = a < b >= c", ["y = a <= b >= c", "y = a > b >= c", "y = a < b > c", "y = a < b <= c"]),
    ("unit", "y = LIMIT", ["y = (LIMIT * 1000)"]),
    ("unit", "y = a.PERIOD_NS", ["y = (a.PERIOD_NS * 1e-9)"]),
    ("unit", "y = OTHER", []),
    ("unit", "y = 0.5 * x", ["y = (0.5 * 1000) * x"]),
    ("unit", "y = x / 1e9", ["y = x / (1e9 * 1e-9)"]),
    ("unit", "y = 2 * x ** 0.5", []),
    ("unit", "y = math.radians(a + 1)", ["y = (a + 1)"]),
    ("unit", "TURN = np.deg2rad(3.0)", ["TURN = (3.0)"]),
    ("swap", "f(a, b, c)", ["f(b, a, c)", "f(a, c, b)"]),
    ("swap", "f(a,\n  b)", ["f(b,\n  a)"]),
    ("swap", "f(a, a, *b)", []),
    ("swap", "max(a, b)\nisinstance(a, b)\nf('text', a)\nparam(a, b)\nf(lambda: 1, a)", []),
    ("check", "def f(a):\n    if not a:\n        return 1\n    return 2", ["if False:"]),
    ("check", "def f(a):\n    if (a and\n  b):\n        raise ValueError(a < 1)", ["if (False):"]),
    ("check", "for a in b:\n    if a:\n        n = 1\n        continue", ["if False:"]),
    ("check", "if a:\n    n = 1", []),
    ("constant", "LIMIT = 3", ["LIMIT = 6"]),
    ("constant", "LIMITS: dict[str, float] = {'a': 0.25, 'b': 0}", ["LIMITS: dict[str, float] = {'a': 0.5, 'b': 0}"]),
    ("constant", "LIMIT = 1 << 20", ["LIMIT = 2 << 20"]),
    (
        "constant",
        "def f(a=1.0, *, b=True, c=2): ...",
        ["def f(a=2.0, *, b=True, c=2): ...", "def f(a=1.0, *, b=True, c=4): ..."],
    ),
    ("constant", "class A:\n    x: int = 3", ["class A:\n    x: int = 6"]),
    ("constant", "class A:\n    x: int = param(3, 'm', low=1)", ["class A:\n    x: int = param(6, 'm', low=1)"]),
    ("constant", "y = 3", []),
    ("boolean", "y = a and b", ["y = a or b"]),
    ("boolean", "y = a or (b) or c", ["y = a and (b) or c", "y = a or (b) and c"]),
    ("extreme", "y = min(a, b)", ["y = max(a, b)"]),
    ("extreme", "y = np.nanargmax(a).min()", ["y = np.nanargmax(a).max()", "y = np.nanargmin(a).min()"]),
    ("negation", "y = not a", ["y = a"]),
    ("negation", "y = a is not None", ["y = a is None"]),
    ("negation", "y = a not in b", ["y = a in b"]),
]


@pytest.mark.parametrize(("kind", "text", "expected"), FAULTS)
def test_each_kind_of_fault(kind, text, expected):
    found = changed(text, kind)
    if kind == "check":
        found = [line.strip() for item in found for line in item.splitlines() if "False" in line]
    assert sorted(found) == sorted(expected)


def test_every_kind_is_tried():
    assert {kind for kind, _, expected in FAULTS if expected} == KINDS.keys()


@pytest.mark.parametrize(
    "text",
    [
        '"""a - b < 3"""',
        "def f(a: X[-1]) -> Y[-2]: ...",
        "@g(a, b)\ndef f(): ...",
        "@dataclass(order=True)\nclass A(B, metaclass=g(a, b)): ...",
        "raise ValueError(f(a, b) - 1)",
        "assert a < b",
        "y = f'{a - b}'",
        "log.warning(a - b, c)",
        "parser.add_argument('-a', b, default=-1)",
        "class A(IntEnum):\n    B = 1",
        "def warm_up():\n    f(1, 2)",
        "if TYPE_CHECKING:\n    y = -x",
        "y = np.cumsum(x, axis=-1)",
    ],
)
def test_what_no_test_could_notice_is_left_alone(text):
    assert changed(text) == []


def test_nothing_but_the_fault_changes():
    text = 'é = "größer"\nπ = [\n    a   -  b,  # ä - ö\n]\n'
    assert changed(text, "sign") == [text.replace("a   -  b", "a   +  b")]
    (mutant,) = mutants_of(text.encode(), "a.py", set())
    assert (mutant.line, mutant.change, mutant.text) == (3, "- -> +", "a   -  b,  # ä - ö")


def test_constants_are_numbers_wherever_they_are_assigned():
    texts = ["A = 3\nB = 2 * A\nC = 'c'\nD = (1, 2)\nE = 1\nF = A", "E = ()\nG: float = -1.0\nh = 2\nH = radians(4)"]
    assert numeric_constants(map(ast.parse, texts)) == {"A", "B", "G", "H"}


def test_a_sample_takes_the_kinds_in_turn_and_begins_with_the_smaller_one():
    mutants = mutants_of(b"y = f(a < b, -c, d < e, g < h, i < j)", "a.py", set())
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
    "car/params.py": "y = -1\n",
    "sphere_nav_tools/offline/drive.py": "y = -1\n",
    "test/sphere_nav_tools/offline/test_all.py": "",
    "test/sphere_nav_tools/cli/test_drive.py": "from sphere_nav_tools.offline import drive\n",
    "test/architecture/test_params.py": "",
    "test/config/test_yaml_matches_params.py": "",
    "test/nodes/test_car_driver_speed.py": "from car.ros import driver\n",
    "test/nodes/test_other.py": "from car.ros import driver\n",
}


@pytest.fixture
def project(tmp_path):
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def test_a_room_of_the_library_is_a_package():
    names = ["sphere_nav/geometry/files/rig.py", "sphere_nav/version.py", "car/ros/driver.py"]
    assert [package_of(PurePosixPath(name)) for name in names] == ["sphere_nav/geometry", "sphere_nav", "car"]


def test_mutants_are_in_modules_that_do_something(project):
    found = all_mutants(Tree(project))
    paths = {name: {mutant.path for mutant in mutants} for name, mutants in found.items()}
    assert paths == {
        "sphere_nav/geometry": {"sphere_nav/geometry/angles.py"},
        "sphere_nav_tools/offline": {"sphere_nav_tools/offline/drive.py"},
        "car": {"car/law.py", "car/follower.py", "car/params.py", "car/ros/driver.py"},
    }


def test_the_mirror_and_the_importers_run_first_then_the_rest_the_nearest_first(project):
    near, rest = Tree(project).tests_of(PurePosixPath("car/law.py"))
    assert near == [f"test/car/test_{name}.py" for name in ("law", "steering", "wrong")]
    assert rest == [f"test/car/test_{name}.py" for name in ("follower", "a_page")]
    near, rest = Tree(project).tests_of(PurePosixPath("sphere_nav/geometry/angles.py"))
    assert (near, rest) == (["test/sphere_nav/geometry/test_angles.py"], ["test/sphere_nav/geometry/test_far.py"])


def test_a_shell_has_the_tests_of_its_nodes(project):
    near, rest = Tree(project).tests_of(PurePosixPath("car/ros/driver.py"))
    assert near == ["test/nodes/test_car_driver_speed.py"]
    assert len(rest) == 5


def test_what_commands_do_has_the_tests_of_the_commands(project):
    near, rest = Tree(project).tests_of(PurePosixPath("sphere_nav_tools/offline/drive.py"))
    assert (near, rest) == (["test/sphere_nav_tools/cli/test_drive.py"], ["test/sphere_nav_tools/offline/test_all.py"])


def test_parameters_have_the_tests_of_all_parameters(project):
    near, rest = Tree(project).tests_of(PurePosixPath("car/params.py"))
    assert near == ["test/architecture/test_params.py", "test/config/test_yaml_matches_params.py"]
    assert len(rest) == 5


def test_a_constant_has_the_tests_of_its_users(project):
    (project / "car/constants.py").write_text("LIMIT, RATE = 1, 2\nGAP = 3\n")
    (project / "car/law.py").write_text("from car.constants import LIMIT\n")
    (project / "car/speed.py").write_text("from car.constants import GAP\n")
    tree, path = Tree(project), PurePosixPath("car/constants.py")
    (near, _), (others, _) = (tree.tests_of(path, line) for line in ("LIMIT, RATE = 1, 2", "GAP = 3"))
    assert near == [f"test/car/test_{name}.py" for name in ("law", "steering", "wrong")]
    assert others == tree.tests_of(path)[0] == []


def test_mutants_run_in_a_copy_without_the_tests_that_fail_anyway(project, tmp_path_factory, monkeypatch):
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")  # half the time of a run
    subprocess.run(["git", "init", "-q"], cwd=project, check=True)
    tree, broken = Tree(project), set()
    stage = Stage(project, tree.packages, tmp_path_factory.mktemp("stage"), broken)
    mutants = {mutant.change: mutant for mutant in all_mutants(tree)["car"] if mutant.path == "car/law.py"}
    outcomes = []
    for change in ("max -> min", "> -> >="):
        result = Result("car", mutants[change])
        stage.judge(result, tree.tests_of(PurePosixPath("car/law.py")), 60.0)
        outcomes.append((result.outcome, result.by, result.is_cut))
    assert outcomes == [("killed", "test/car/test_steering.py::test_it", False), ("survived", "", False)]
    assert broken == {"test/car/test_wrong.py::test_it"}
    for name, text in FILES.items():
        assert (project / name).read_text() == (stage.checkout / name).read_text() == text


def test_a_result_is_found_again_where_its_line_is_now():
    text = b"x = 1\ny = a < b\nz = c - d\ny = a < b\n"
    now = {"lib/a": mutants_of(text, "lib/a/law.py", set()), "b": mutants_of(text, "b/other.py", set())}
    before = mutants_of(b"y = a < b\ny = e - f\n", "a/law.py", set())
    items = [asdict(Result("a", mutant, "killed", "test", seconds=2.0)) for mutant in before]
    found, gone = earlier_results(now, items)
    assert [(item.package, item.mutant.where, item.mutant.change, item.by) for item in found] == [
        ("lib/a", "lib/a/law.py:2  bound", "< -> <=", "test"),
        ("lib/a", "lib/a/law.py:2  bound", "< -> >", "test"),
    ]
    assert [mutant.text for mutant in gone] == ["y = e - f"]


def test_the_packages_take_turns():
    mutants = {name: mutants_of(b"y = -x < 3", f"{name}/a.py", set()) for name in ("b", "a")} | {"c": []}
    assert [item.package for item in sample_of(mutants, 1, 2)] == ["a", "b", "a", "b"]


class Scripted(Stage):
    """A stage whose runs end as they are told: by the first file or test of a run and whether there is a mutant."""

    def __init__(self, **outcomes):
        self.outcomes, self.broken, self._sound = outcomes, set(), set()

    def run(self, tests, limit, mutant=None, *, is_collecting=False):
        outcome = self.outcomes.get(tests[0] + ("_mutant" if mutant else ""), "passed")
        return Run(outcome, f"{tests[0]}x")


@pytest.mark.parametrize(
    ("outcomes", "expected"),
    [
        ({}, ("survived", "", False)),
        ({"a_mutant": "failed"}, ("killed", "ax", False)),
        ({"b_mutant": "failed"}, ("killed", "bx", False)),
        ({"a_mutant": "failed", "ax": "failed"}, ("survived", "", False)),
        ({"a_mutant": "timed out", "ax_mutant": "timed out"}, ("timed out", "ax", False)),
        ({"a_mutant": "timed out", "ax_mutant": "timed out", "ax": "timed out"}, ("survived", "", True)),
        ({"a_mutant": "timed out"}, ("survived", "", True)),
    ],
)
def test_what_counts_as_noticed(outcomes, expected):
    stage, result = Scripted(**outcomes), Result("a", MUTANT)
    if outcomes.get("ax") == "failed":  # the file is left out once its failing test is known
        stage.run = lambda *args, **options: Run("failed" if not stage.broken else "passed", "a")
        stage._is_sound = lambda test, limit: False
    stage.judge(result, (["a"], ["b"]), 60.0)
    assert (result.outcome, result.by, result.is_cut) == expected


BUSY = "import time\ndef work(end=time.monotonic() + 1.5):\n    while time.monotonic() < end: pass\n"


@pytest.mark.parametrize(
    ("code", "limit", "idle", "expected"),
    [
        ("import time; time.sleep(1.2)", 0.6, 60, 0),  # what waits takes no CPU time
        ("sum(1 for _ in iter(int, 1))", 0.3, 30, None),
        ("import os\nwhile True: os.fork() and os.wait() or (sum(range(5_000_000)), os._exit(0))", 0.3, 30, None),
        ("import time; time.sleep(600)", 0.3, 2, None),  # but not without end
        (BUSY + "work()", 60, 0.01, 0),  # however long it takes by the clock
        (BUSY + "import threading; threading.Thread(target=work).start()", 60, 0.01, 0),
    ],
)
def test_the_limit_is_of_cpu_time(tmp_path, monkeypatch, code, limit, idle, expected):
    monkeypatch.setattr(mutants, "POLL", 0.05)
    monkeypatch.setattr(mutants, "IDLE", idle)
    stage = Scripted()
    stage.environment = os.environ | {"STAGE": str(tmp_path)}
    process = subprocess.Popen([sys.executable, "-S", "-c", code], env=stage.environment)
    try:
        found, seconds = stage._wait(process, limit)
    finally:
        stage._end_processes()
        process.wait()
    assert found == expected
    assert (limit <= seconds < 8 * limit) == (idle == 30)


def test_the_time_of_all_runs_of_a_mutant_counts_together():
    stage, limits = Scripted(), []

    def run(tests, limit, mutant=None, *, is_collecting=False):
        limits.append(limit)
        return Run("passed", seconds=25.0)

    stage.run, result = run, Result("a", MUTANT)
    stage.judge(result, (["a"], ["b"]), 60.0)
    assert (limits, result.seconds) == ([60.0, 35.0], 50.0)


def test_a_quick_run_leaves_the_rest_of_the_tests():
    for tests, expected in (((["a"], ["b"]), True), ((["a"], []), False), (([], ["a"]), False)):
        result = Result("a", MUTANT)
        Scripted(b_mutant="failed").judge(result, tests, 60.0, is_near=True)
        assert (result.outcome, result.is_cut) == ("survived", expected)


def test_the_table_counts_by_package():
    outcomes = [("a", "killed"), ("a", "survived"), ("b", "timed out"), ("b", "killed")]
    results = [Result(package, MUTANT, outcome) for package, outcome in outcomes]
    rows = Report(1, None, {"test/a.py::b"}, results).table().splitlines()
    assert rows[2:] == [
        "| a | 2 | 1 | 0 | 1 | 0 | 50% |",
        "| b | 2 | 1 | 1 | 0 | 0 | 100% |",
        "| all | 4 | 2 | 1 | 1 | 0 | 75% |",
        "fails in any case, not used: test/a.py::b",
    ]


def test_a_test_whose_parameter_the_mutant_has_named_counts_by_its_function():
    stage = Scripted(**{"t.py::a[new]": "failed", "t.py::b[x]": "failed", "t.py::b": "failed"})
    assert stage._is_sound("t.py::a[new]", 60.0)
    assert not stage._is_sound("t.py::b[x]", 60.0)
