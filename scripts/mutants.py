"""`python scripts/mutants.py`: put faults into the code on purpose and count how many the tests notice.

A mutant is the product with one small fault (`FAULTS`). Of every package some are drawn by `--seed`, of each kind in
turn. Each runs in a copy, against the fast tests that mirror or import its module and then, but for `--near`, against
those of its package; a test counts that passes without it. Mutants that change no result count as survivors.
`--pinned` draws numbers of constants.py instead, each doubled and halved, against the tests that its comment names.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SKIPPED = {"kernels", "warm_up", "plot", "plots", "figure", "figures"}  # a name of a module, or one of its words
PATIENCE = 5  # times the CPU time that tests may take by the clock: other work makes no time-out
UNCHANGED_CALLS = {"add_argument", "add_parser", "debug", "info", "warning", "error", "exception", "log", "print"}
UNCHANGED_FIELDS = {"annotation", "returns", "decorator_list", "bases", "keywords"}
UNSWAPPED = {"min", "max", "minimum", "maximum", "hypot", "isclose", "allclose", "array_equal", "multiply", "add"}
UNSWAPPED |= {"isinstance", "issubclass", "getattr", "hasattr", "setattr", "array", "asarray", "full", "param"}
ANGLES = {"radians", "degrees", "deg2rad", "rad2deg"}
EXTREMES = {"min": "max", "argmin": "argmax", "nanmin": "nanmax", "nanargmin": "nanargmax", "minimum": "maximum"}
EXTREMES |= {new: old for old, new in EXTREMES.items()}
TEST_NAMES = r"\b(?:\w+/)*test_\w+"
BOUNDS = {ast.Lt: ("<", "<=", ">"), ast.LtE: ("<=", "<", ">="), ast.Gt: (">", ">=", "<"), ast.GtE: (">=", ">", "<=")}

Edit = tuple[int, int, str]  # begin and end in bytes of the file, what stands there instead


@dataclass(frozen=True)
class Mutant:
    """One fault: where, which, and the bytes of the file that it replaces."""

    path: str
    line: int
    kind: str
    begin: int
    end: int
    new: str

    def apply(self, text: bytes) -> bytes:
        """Return a module with its fault."""
        return text[: self.begin] + self.new.encode() + text[self.end :]

    def describe(self, text: bytes) -> str:
        """Return place, kind and change, for a reader."""
        return f"{self.path}:{self.line}  {self.kind}: {text[self.begin : self.end].decode()!r} -> {self.new!r}"


class Source:
    """One module, by the nodes of its syntax tree."""

    def __init__(self, text: bytes) -> None:
        self.text = text
        lengths = [len(line) for line in text.splitlines(keepends=True)]
        self._starts = [sum(lengths[:k]) for k in range(len(lengths) + 1)]

    def span(self, node: ast.expr) -> tuple[int, int]:
        """Return the bytes of a node."""
        begin = self._starts[node.lineno - 1] + node.col_offset
        return begin, self._starts[(node.end_lineno or 0) - 1] + (node.end_col_offset or 0)

    def of(self, node: ast.expr) -> str:
        """Return the text of a node."""
        return self.text[slice(*self.span(node))].decode()

    def between(self, left: ast.expr, right: ast.expr, old: str, new: str) -> Iterator[Edit]:
        """Yield the change of an operator between two nodes; none where a comment could be meant."""
        begin, end = self.span(left)[1], self.span(right)[0]
        gap = self.text[begin:end]
        if b"#" not in gap and gap.count(old.encode()) == 1:
            begin += gap.index(old.encode())
            yield begin, begin + len(old), new


def signs(source: Source, node: ast.AST) -> Iterator[Edit]:
    """A minus dropped, one added to a product, plus for minus."""
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        begin, _ = source.span(node)
        yield begin, begin + 1, ""
    elif isinstance(node, ast.BinOp) and not is_text(node.left) and not is_text(node.right):
        if isinstance(node.op, ast.Mult):
            yield source.span(node)[0], source.span(node)[0], "-"
        elif isinstance(node.op, ast.Add | ast.Sub):
            yield from source.between(node.left, node.right, *("+-" if isinstance(node.op, ast.Add) else "-+"))


def bounds(source: Source, node: ast.AST) -> Iterator[Edit]:
    """A bound that belongs to the other side, a comparison turned round, the smallest for the largest."""
    if isinstance(node, ast.Compare):
        sides = [node.left, *node.comparators]
        for left, operator, right in zip(sides, node.ops, sides[1:], strict=False):
            old, *others = BOUNDS.get(type(operator), ("",))
            for new in others:
                yield from source.between(left, right, old, new)
    elif isinstance(node, ast.Call) and name_of(node) in EXTREMES:
        name, end = name_of(node), source.span(node.func)[1]
        yield end - len(name), end, EXTREMES[name]


def units(source: Source, node: ast.AST) -> Iterator[Edit]:
    """An angle that is not converted, a fraction or a large number in another unit."""
    if isinstance(node, ast.Call) and name_of(node) in ANGLES and len(node.args) == 1:
        yield *source.span(node), f"({source.of(node.args[0])})"
    elif isinstance(node, ast.BinOp | ast.Compare) and not isinstance(getattr(node, "op", None), ast.Pow):
        for side in [node.left, *(node.comparators if isinstance(node, ast.Compare) else [node.right])]:
            if isinstance(side, ast.Constant) and (type(side.value) is float or number(side) >= 1000) and number(side):
                yield *source.span(side), f"({source.of(side)} * 1000)"


def swaps(source: Source, node: ast.AST) -> Iterator[Edit]:
    """Two arguments side by side change places."""
    if isinstance(node, ast.Call) and name_of(node) not in UNSWAPPED:
        for left, right in zip(node.args, node.args[1:], strict=False):
            gap = source.text[source.span(left)[1] : source.span(right)[0]].decode()
            is_alike = is_text(left) == is_text(right) and not {type(left), type(right)} & {ast.Starred, ast.Lambda}
            if is_alike and gap.strip() == "," and ast.dump(left) != ast.dump(right):
                yield source.span(left)[0], source.span(right)[1], source.of(right) + gap + source.of(left)


def checks(source: Source, node: ast.AST) -> Iterator[Edit]:
    """A check that never finds anything."""
    leaves = ast.Raise | ast.Return | ast.Continue
    if isinstance(node, ast.If) and len(node.body) <= 2 and isinstance(node.body[-1], leaves):
        yield *source.span(node.test), "False"


def constants(source: Source, node: ast.AST) -> Iterator[Edit]:
    """A number in a constant or a default twice as large."""
    values: list[ast.AST | None] = []
    if isinstance(node, ast.Assign | ast.AnnAssign):
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        if isinstance(node, ast.AnnAssign) or all(name_of(target).isupper() for target in targets):
            values = [node.value]
    elif isinstance(node, ast.arguments):
        values = [*node.defaults, *node.kw_defaults]
    for value in filter(None, values):
        first = value.args[0] if isinstance(value, ast.Call) and name_of(value) == "param" else value
        for item in ast.walk(first):
            if isinstance(item, ast.Constant) and number(item):
                yield *source.span(item), repr(2 * number(item))


def booleans(source: Source, node: ast.AST) -> Iterator[Edit]:
    """One `and` for `or`, or the other way round; a `not` that is gone."""
    if isinstance(node, ast.BoolOp):
        words = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
        for left, right in zip(node.values, node.values[1:], strict=False):
            yield from source.between(left, right, *words)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        yield source.span(node)[0], source.span(node)[0] + len("not "), ""
    elif isinstance(node, ast.Compare) and isinstance(node.ops[0], ast.IsNot | ast.NotIn):
        words = ("is not", "is") if isinstance(node.ops[0], ast.IsNot) else ("not in", "in")
        yield from source.between(node.left, node.comparators[0], *words)


FAULTS = signs, bounds, units, swaps, checks, constants, booleans
KINDS: dict[str, Callable[[Source, ast.AST], Iterator[Edit]]] = {one.__name__.removesuffix("s"): one for one in FAULTS}


def mutants_of(text: bytes, path: str) -> list[Mutant]:
    """Return every mutant of a module."""
    source, found = Source(text), dict[Edit, Mutant]()
    for node in changeable(ast.parse(text)):
        for kind, edits in KINDS.items():
            for edit in edits(source, node):
                found.setdefault(edit, Mutant(path, text.count(b"\n", 0, edit[0]) + 1, kind, *edit))
    return list(found.values())


def changeable(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes that may change."""
    for name, value in ast.iter_fields(node):
        if name not in UNCHANGED_FIELDS or (name == "keywords" and isinstance(node, ast.Call)):
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST) and not is_unchanged(child):
                    yield child
                    yield from changeable(child)


def is_unchanged(node: ast.AST) -> bool:
    """Whether a node and all below it stay as they are."""
    if isinstance(node, ast.ClassDef):
        return any(name_of(base).endswith(("Enum", "Flag", "Protocol")) for base in node.bases)
    if isinstance(node, ast.If):
        return "TYPE_CHECKING" in ast.dump(node.test) or "__main__" in ast.dump(node.test)
    if isinstance(node, ast.keyword):
        return node.arg in ("axis", "low", "high", "help", "stacklevel")
    if isinstance(node, ast.Call):
        return name_of(node) in UNCHANGED_CALLS
    return isinstance(node, ast.Raise | ast.Assert | ast.JoinedStr)


def number(node: ast.AST) -> float:
    """Return a number as written; 0 for anything else, which no fault changes either."""
    return node.value if isinstance(node, ast.Constant) and type(node.value) in (int, float) else 0


def is_text(node: ast.AST) -> bool:
    """Whether a node is a text or a sequence as written, which has no sign."""
    if isinstance(node, ast.Constant):
        return type(node.value) not in (int, float)
    return isinstance(node, ast.List | ast.Tuple | ast.Set | ast.Dict | ast.ListComp | ast.JoinedStr)


def name_of(node: ast.AST) -> str:
    """Return the last part of a name, or that of what is called."""
    node = node.func if isinstance(node, ast.Call) else node
    return node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""


def draw(mutants: list[Mutant], count: int, rng: random.Random) -> list[Mutant]:
    """Return a sample, one of each kind in turn; a larger one begins with the smaller."""
    seen, ranked = Counter[str](), list[tuple[int, Mutant]]()
    for mutant in rng.sample(mutants, len(mutants)):
        ranked.append((seen[mutant.kind], mutant))
        seen[mutant.kind] += 1
    return [mutant for _, mutant in sorted(ranked, key=lambda pair: pair[0])][:count]


def package_of(path: Path) -> str:
    """Return the package that a module belongs to; of the library its room."""
    return "/".join(path.parts[: 1 + (path.parts[0] == "sphere_nav" and len(path.parts) > 2)])


def near_and_other_tests(root: Path, path: Path) -> tuple[list[str], list[str]]:
    """Return the test files that mirror or name a module, and the others of its package and its nodes."""
    package, parent, name = package_of(path), ".".join(path.parts[:-1]), path.stem
    named = re.compile(rf"\b{parent}\.{name}\b|from {parent} import .*\b{name}\b")
    own, near, others = f"test_{package.partition('/')[0]}", list[str](), list[str]()
    for folder in (package, "nodes", "laws", "config"):
        for file in sorted((root / "test" / folder).rglob("test_*.py")):
            is_near = file.name.endswith(f"_{name.strip('_')}.py") or named.search(file.read_text(encoding="utf-8"))
            if is_near or folder == package or file.name.startswith(own):
                (near if is_near else others).append(str(file.relative_to(root)))
    return near, others


class Stage:
    """A copy of the checkout and of the packages as they would be installed, in which one mutant at a time lives."""

    def __init__(self, root: Path, packages: set[str], folder: Path, marks: str = "not slow and not dds") -> None:
        self.folder, self.marks, self.broken = folder, marks, set[str]()  # broken: tests that fail without a mutant
        listed = subprocess.run(["git", "ls-files", "-coz", "--exclude-standard"], cwd=root, capture_output=True)
        for name in listed.stdout.decode().split("\0"):
            if (root / name).is_file() and not name.startswith("test/installation/"):
                for place in ("checkout", *(["site"] if name.split("/")[0] in packages else [])):
                    (folder / place / name).parent.mkdir(parents=True, exist_ok=True)
                    shutil.copy2(root / name, folder / place / name)
        (folder / "home").mkdir()
        with suppress(OSError):  # they are compiled anew
            shutil.copytree(Path.home() / ".cache" / "sphere_nav" / "kernels", folder / "kernels")
        places = {"HOME": "home", "TMPDIR": "home", "NUMBA_CACHE_DIR": "kernels", "PYTHONPATH": "site"}
        self.environment = os.environ | {name: str(folder / place) for name, place in places.items()}

    def judge(self, mutant: Mutant, tests: list[str], limit_s: float) -> tuple[str, str]:
        """Run tests with a mutant; return `killed`, `timed out` or `survived`, and the test that noticed it."""
        copies = [self.folder / place / mutant.path for place in ("checkout", "site")]
        text = copies[0].read_bytes()
        while True:
            try:
                for copy in copies:
                    copy.write_bytes(mutant.apply(text))
                outcome, test = self.run(tests, limit_s)
                if test and self.run([test], limit_s)[0] == "survived":  # it was slow: kernels were compiled
                    outcome, test = self.run(tests, limit_s)
            finally:
                for copy in copies:
                    copy.write_bytes(text)
            if outcome == "survived" or self.run([test.partition("[")[0]] if test else tests, limit_s)[0] == "survived":
                return outcome, test
            if not test:
                raise RuntimeError("no test runs without a fault: " + (self.folder / "log").read_text())
            if test in self.broken:
                return "survived", ""
            self.broken.add(test)

    def run(self, tests: list[str], limit_s: float) -> tuple[str, str]:
        """Run pytest until the first failure; return how it ended, and the test that failed or was running."""
        words = ["-v", "-x", "--tb=no", "--no-header", "-rfE", "-p", "no:cacheprovider", "-p", "no:xdist"]
        words += ["-m", self.marks, *tests]
        words += [word for test in sorted(self.broken) for word in ("--deselect", test)]
        command, log = [sys.executable, "-B", "-P", "-m", "pytest", *words], self.folder / "log"
        with log.open("w") as stream:
            process = subprocess.Popen(
                command, cwd=self.folder / "checkout", env=self.environment, stdout=stream, stderr=stream,
                start_new_session=True,
                preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (round(limit_s), round(limit_s))),
            )  # fmt: skip
            try:
                code = process.wait(PATIENCE * limit_s)
            except subprocess.TimeoutExpired:
                code = -1
            finally:
                with suppress(OSError):  # all have ended
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        if code in (0, 5):  # 5: all tests deselected
            return "survived", ""
        said = log.read_text(errors="replace")
        tests = re.findall(r"^(?:FAILED|ERROR) (\S+)", said, re.M) or re.findall(r"^(test/\S+::\S+)", said, re.M)
        return "timed out" if code < 0 else "killed", tests[-1] if tests else ""


def main() -> int:
    """Draw mutants, run them, print what became of each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=6, help="mutants of each package (6)")
    parser.add_argument("--package", action="append", default=[], help="only this one; may be repeated")
    parser.add_argument("--limit", type=float, default=120.0, help="seconds of CPU for the tests of one mutant (120)")
    parser.add_argument("--near", action="store_true", help="only tests that mirror or import the module")
    parser.add_argument("--pinned", action="store_true", help="only numbers of constants.py, by the tests they name")
    options = parser.parse_args()
    mutants, counts = all_mutants(ROOT), Counter[tuple[str, str]]()
    with tempfile.TemporaryDirectory(prefix="mutants_") as name:
        marks = "not dds" if options.pinned else "not slow and not dds"
        stage = Stage(ROOT, {package.split("/")[0] for package in mutants}, Path(name), marks)
        for package, found in sorted(mutants.items()):
            pool = [one for one in found if not options.pinned or (one.kind == "constant" and named_tests(ROOT, one))]
            is_chosen = not options.package or package in options.package
            for mutant in draw(pool, options.count * is_chosen, random.Random(f"{options.seed} {package}")):
                for trial, tests in trials(ROOT, mutant, options):
                    outcome, by = stage.judge(trial, tests, options.limit) if tests else ("survived", "")
                    if outcome != "survived":
                        break
                counts[package, outcome] += 1
                sys.stdout.write(f"{outcome:9}  {mutant.describe((ROOT / mutant.path).read_bytes())}  {by}\n")
                sys.stdout.flush()
    sys.stdout.writelines(f"{package}: {number} {outcome}\n" for (package, outcome), number in sorted(counts.items()))
    return 0


def trials(root: Path, mutant: Mutant, options: argparse.Namespace) -> list[tuple[Mutant, list[str]]]:
    """Return what is tried until one is noticed: a fault, and test files."""
    if not options.pinned:
        return [(mutant, tests) for tests in near_and_other_tests(root, Path(mutant.path))[: 2 - options.near]]
    old = ast.literal_eval((root / mutant.path).read_bytes()[mutant.begin : mutant.end].decode())
    half = replace(mutant, new=repr(old / 2 if isinstance(old, float) else old // 2))
    return [(one, named_tests(root, mutant)) for one in (mutant, half)]


def named_tests(root: Path, mutant: Mutant) -> list[str]:
    """Return the test files that the comment of a number names, or else that of its group, in a constants.py."""
    path, group, previous = Path(mutant.path), "", ""
    if path.name != "constants.py":
        return []
    for number, line in enumerate((root / path).read_text(encoding="utf-8").splitlines(), 1):
        if line.startswith("#"):
            group = f"{group} {line}" if previous.startswith("#") else line
        previous = line
        if number == mutant.line:
            names = set(re.findall(TEST_NAMES, line) or re.findall(TEST_NAMES, group))
            files = [*(root / "test").rglob("test_*.py")]
            ends = tuple(f"/{name}.py" for name in names)
            return sorted(str(file.relative_to(root)) for file in files if str(file).endswith(ends))
    return []


def all_mutants(root: Path) -> dict[str, list[Mutant]]:
    """Return the mutants of the packages that setup.py names, by package."""
    listed = (root / "setup.py").read_text(encoding="utf-8").partition("PACKAGES = ")[2]
    found: dict[str, list[Mutant]] = {}
    for name in ast.literal_eval(listed[: listed.index(")") + 1]):
        for path in sorted(path.relative_to(root) for path in (root / name).rglob("*.py")):
            if path.name != "__init__.py" and not SKIPPED & {path.stem, *path.stem.split("_")}:
                found.setdefault(package_of(path), []).extend(mutants_of((root / path).read_bytes(), str(path)))
    return found


if __name__ == "__main__":
    sys.exit(main())
