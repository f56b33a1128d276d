"""`python scripts/mutants.py`: put faults into the code on purpose and count how many the tests notice.

A mutant is the product with one small fault: a sign, a bound, a unit, two swapped arguments, a check that is gone, a
constant twice as large, `and` for `or`, `min` for `max`, a `not` that is gone. Of every package some are drawn by
`--seed`, one of each kind in turn, and each runs against the tests of its own package alone:

1. the test that mirrors the module and those that import it, for a ROS shell also those of its node in test/nodes;
2. if they pass, the rest of the package's tests, those nearest to the module first, until `--limit` seconds are over.

Everything happens in a copy, with the copy's packages in front of the installed ones. A kill counts if the failing
test passes without the mutant; a time-out if the test that was running takes too long by itself, and only with the
mutant. Mutants that change no result (`<` and `<=` of two floats) are not sorted out: they count as survivors.
Recordings are used where SPHERE_NAV_DATA names them. Run it with the environment's python.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path, PurePosixPath
from queue import Queue
from typing import Any

from mutations import Mutant, apply, draw, mutants_of, numeric_constants

ROOT = Path(__file__).resolve().parents[1]
LIBRARY = "sphere_nav"  # its rooms count as packages
SKIPPED_NAMES = ("kernels", "warm_up", "plot", "figure")  # modules whose name begins so, or ends so after `_`
NEAR = 1  # tests at this distance of imports from a module, or nearer, run first


@dataclass
class Result:
    """What became of a mutant: `killed`, `timed out` or `survived`; cut where not all tests were run in time."""

    package: str
    mutant: Mutant
    outcome: str = "survived"
    by: str = ""
    is_cut: bool = False
    seconds: float = 0.0

    def line(self) -> str:
        """Return one line for a reader, the source line below it for a survivor."""
        where = f"{self.mutant.path}:{self.mutant.line}"
        text = f"{self.outcome:9} {self.seconds:4.0f} s  {where}  {self.mutant.kind}: {self.mutant.change}"
        cut = "  (not all tests run)" if self.is_cut else ""
        return text + (
            f"{cut}\n                 {self.mutant.text}" if self.outcome == "survived" else f"  [{self.by}]"
        )


class Tree:
    """The checkout: its packages, the modules to mutate, who imports whom, and the tests of each module."""

    def __init__(self, root: Path) -> None:
        body = ast.parse((root / "setup.py").read_text(encoding="utf-8")).body
        given = {ast.unparse(node.targets[0]): node.value for node in body if isinstance(node, ast.Assign)}
        self.root = root
        self.packages: tuple[str, ...] = ast.literal_eval(given["PACKAGES"])
        self.executables: dict[str, str] = ast.literal_eval(given["EXECUTABLES"])
        product = [path for name in self.packages for path in (root / name).rglob("*.py")]
        self.modules = sorted(PurePosixPath(path.relative_to(root)) for path in product)
        self.tests = sorted(PurePosixPath(path.relative_to(root)) for path in (root / "test").rglob("*.py"))
        self._trees = {path: ast.parse((root / path).read_text("utf-8")) for path in (*self.modules, *self.tests)}
        self._paths = {dotted(path): path for path in self._trees}
        self._importers: dict[PurePosixPath, set[PurePosixPath]] = {}
        for path in self._trees:
            for imported in self._imports(path):
                self._importers.setdefault(imported, set()).add(path)

    def mutants(self) -> dict[str, list[Mutant]]:
        """Return all mutants by package."""
        constants = numeric_constants([self._trees[path] for path in self.modules])
        found: dict[str, list[Mutant]] = {}
        for path in self.modules:
            words = path.stem.split("_")
            is_skipped = any(path.stem.startswith(name) or words[-1] == name for name in SKIPPED_NAMES)
            if not is_skipped and not self._is_index(path):
                text = (self.root / path).read_bytes()
                found.setdefault(package_of(path), []).extend(mutants_of(text, str(path), constants))
        return found

    def tests_of(self, path: PurePosixPath) -> tuple[list[str], list[str]]:
        """Return the test files of a module's package: those near to the module, and the others, nearest first."""
        package = PurePosixPath(package_of(path))
        folder = "test" / package
        tests = [test for test in self.tests if test.is_relative_to(folder)]
        if str(package) == LIBRARY:
            tests = [test for test in tests if test.parent == folder]
        if "ros" in path.parts or path.name.endswith("node.py"):
            prefix = f"{dotted(package)}."
            nodes = [package.name, *(name for name, module in self.executables.items() if module.startswith(prefix))]
            starts = tuple(f"test_{name}" for name in nodes)
            tests += [test for test in self.tests if test.parts[1] == "nodes" and test.name.startswith(starts)]
        distances = self._distances(path) | {"test" / path.parent / f"test_{path.stem.strip('_')}.py": 0}
        files = [test for test in tests if test.name.startswith("test_")]
        ranks = sorted((distances.get(test, len(self._trees)), str(test)) for test in files)
        return [test for rank, test in ranks if rank <= NEAR], [test for rank, test in ranks if rank > NEAR]

    def _distances(self, path: PurePosixPath) -> dict[PurePosixPath, int]:
        """Return by how many imports each file is away from a module."""
        found, last = {path: 0}, [path]
        while last:
            news = {importer for item in last for importer in self._importers.get(item, ())} - found.keys()
            found |= dict.fromkeys(news, found[last[0]] + 1)
            last = sorted(news)
        return found

    def _imports(self, path: PurePosixPath) -> set[PurePosixPath]:
        """Return our files that one imports, through indices; a test also depends on the conftest.py above it."""
        names = set()
        for node in ast.walk(self._trees[path]):
            if isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                names |= {f"{node.module}.{alias.name}" for alias in node.names}
        found = {self._resolve(name) for name in names}
        if path.parts[0] == "test":
            found |= {folder / "conftest.py" for folder in path.parents if folder != PurePosixPath("test")}
        return {item for item in found if item in self._trees} - {path}

    def _resolve(self, name: str) -> PurePosixPath | None:
        """Return the file in which a dotted name is defined."""
        if name in self._paths or "." not in name:
            return self._paths.get(name)
        module, _, last = name.rpartition(".")
        index = self._paths.get(module)
        if index and self._is_index(index):
            for node in self._trees[index].body:
                if isinstance(node, ast.ImportFrom) and any((item.asname or item.name) == last for item in node.names):
                    return self._resolve(f"{node.module}.{last}")
        return index

    def _is_index(self, path: PurePosixPath) -> bool:
        """Whether a file only gathers names."""
        kinds = ast.FunctionDef | ast.ClassDef
        return path.name == "__init__.py" and not any(isinstance(node, kinds) for node in self._trees[path].body)


def dotted(path: PurePosixPath) -> str:
    """Return the name that a file is imported by; helpers of tests are imported from test/."""
    parts = path.with_suffix("").parts
    return ".".join(parts[parts[0] == "test" : len(parts) - (parts[-1] == "__init__")])


def package_of(path: PurePosixPath) -> str:
    """Return the package that a module belongs to; of the library its room."""
    return "/".join(path.parts[: 2 if path.parts[0] == LIBRARY and len(path.parts) > 2 else 1])


@dataclass
class Run:
    """How a run of pytest ended: `passed`, `failed` or `timed out`, and the test that failed or was running."""

    outcome: str
    test: str = ""


class Stage:
    """A copy of the checkout and of the packages as they would be installed, in which one mutant at a time lives."""

    def __init__(self, root: Path, packages: tuple[str, ...], folder: Path, broken: set[str]) -> None:
        self.checkout, self.site, self.broken = folder / "checkout", folder / "site", broken
        self._sound: set[str] = set()
        listed = subprocess.run(["git", "ls-files", "-coz", "--exclude-standard"], cwd=root, capture_output=True)
        for name in sorted(set(listed.stdout.decode().split("\0"))):
            if (root / name).is_file() and not name.startswith("test/installation/"):
                copy(root / name, self.checkout / name)
                if name.split("/")[0] in packages:
                    copy(root / name, self.site / name)
        for name in ("home", "tmp"):
            (folder / name).mkdir()
        cache = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "sphere_nav" / "kernels"
        cache = Path(os.environ.get("NUMBA_CACHE_DIR", cache))
        if cache.is_dir():
            shutil.copytree(cache, folder / "kernels")
        places = {"HOME": "home", "TMPDIR": "tmp", "NUMBA_CACHE_DIR": "kernels", "PYTHONPATH": "site", "STAGE": "."}
        self.environment = os.environ | {name: str(folder / place) for name, place in places.items()}
        data = root.parent / "shared" / "data"
        if data.is_dir():
            self.environment.setdefault("SPHERE_NAV_DATA", str(data))
        for path in self.site.rglob("*cli/warm_up.py"):  # compile what the copied cache lacks
            command = [sys.executable, "-P", "-m", dotted(PurePosixPath(path.relative_to(self.site)))]
            subprocess.run(command, env=self.environment, cwd=folder, check=True)

    def judge(self, result: Result, tests: tuple[list[str], list[str]], limit: float) -> None:
        """Run a mutant against its tests and fill in what became of it."""
        begin = time.monotonic()
        for files in filter(None, tests):
            remaining = limit - (time.monotonic() - begin)
            run = self._run_sound(result.mutant, files, remaining) if remaining > 0 else Run("timed out")
            if run.outcome == "timed out" and not self._is_slowed(result.mutant, run.test, limit / 2):
                result.is_cut = True
                break
            if run.outcome != "passed":
                result.outcome, result.by = run.outcome.replace("failed", "killed"), run.test
                break
        result.seconds = round(time.monotonic() - begin, 1)

    def _run_sound(self, mutant: Mutant, files: list[str], limit: float) -> Run:
        """Run tests with a mutant, without those that fail in any case."""
        while files := [name for name in files if name not in self.broken]:
            run = self.run(files, limit, mutant)
            if run.outcome != "failed" or self._is_sound(run.test, limit):
                return run
            self.broken.add(run.test)
        return Run("passed")

    def _is_sound(self, test: str, limit: float) -> bool:
        """Whether a test passes, or its file can be imported, without a mutant."""
        if (
            test not in self._sound
            and self.run([test], max(limit, 60.0), is_collecting="::" not in test).outcome == "passed"
        ):
            self._sound.add(test)
        return test in self._sound

    def _is_slowed(self, mutant: Mutant, test: str, limit: float) -> bool:
        """Whether a test by itself takes longer than `limit` with a mutant, but not without."""
        return bool(test) and all(
            self.run([test], limit, given).outcome == expected
            for given, expected in ((mutant, "timed out"), (None, "passed"))
        )

    def run(self, tests: list[str], limit: float, mutant: Mutant | None = None, *, is_collecting: bool = False) -> Run:
        """Run pytest until the first failure."""
        words = ["-v", "-x", "--tb=no", "--no-header", "-rfE", "-p", "no:cacheprovider"]
        words += ["--collect-only"] if is_collecting else []
        words += [word for test in sorted(self.broken - set(tests)) for word in ("--deselect", test)]
        words += tests
        if mutant:
            original = self._write(mutant.path, None, mutant)
        log = self.site.parent / "log"
        with log.open("w") as stream:
            command = [sys.executable, "-P", "-m", "pytest", *words]
            process = subprocess.Popen(command, cwd=self.checkout, env=self.environment, stdout=stream, stderr=stream)
            try:
                code: int | None = process.wait(limit)
            except subprocess.TimeoutExpired:
                code = None
            finally:
                self._end_processes()
                process.wait()
                if mutant:
                    self._write(mutant.path, original, None)
        if code in (0, 5):  # 5: all tests deselected
            return Run("passed")
        lines = log.read_text(errors="replace").splitlines()
        failed = [line.split(" ", 1)[1].split(" - ")[0] for line in lines if line.startswith(("FAILED ", "ERROR "))]
        running = [line.split(" ")[0] for line in lines if line.startswith("test/") and "::" in line]
        return Run("timed out" if code is None else "failed", (failed or running or tests)[-1])

    def _write(self, path: str, text: bytes | None, mutant: Mutant | None) -> bytes:
        """Write a module in both copies, with a mutant if given; return what stood there."""
        before = (self.site / path).read_bytes()
        after = apply(before, mutant) if mutant else text
        assert after is not None
        for copied in (self.checkout / path, self.site / path):
            copied.write_bytes(after)
            for compiled in (copied.parent / "__pycache__").glob(f"{copied.stem}.*"):
                compiled.unlink()  # it is told from another by size and second only
        return before

    def _end_processes(self) -> None:
        """End every process that was started in here."""
        mark = f"STAGE={self.environment['STAGE']}".encode()
        for folder in Path("/proc").glob("[0-9]*"):
            try:
                if mark in (folder / "environ").read_bytes().split(b"\0"):
                    os.kill(int(folder.name), signal.SIGKILL)
            except OSError:
                pass  # it ended by itself, or is not ours


def copy(source: Path, target: Path) -> None:
    """Copy one file."""
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy2(source, target)


@dataclass
class Report:
    """Results as they come; the JSON file is whole after each of them."""

    seed: int
    path: Path | None
    broken: set[str] = field(default_factory=set)
    results: list[Result] = field(default_factory=list)

    def add(self, result: Result) -> None:
        """Print a result and keep it."""
        self.results.append(result)
        say(result.line())
        if self.path:
            head: dict[str, Any] = {"seed": self.seed, "broken": sorted(self.broken)}
            text = json.dumps(head | {"results": [asdict(item) for item in self.results]}, indent=1)
            self.path.write_text(text + "\n")

    def table(self) -> str:
        """Return a Markdown table by package; the share of mutants that were noticed is the last column."""
        rows = ["| package | mutants | killed | timed out | survived | of them not all tests run | noticed |"]
        rows += ["| --- " * 7 + "|"]
        for name in [*sorted({result.package for result in self.results}), "all"]:
            chosen = [result for result in self.results if name in ("all", result.package)]
            outcomes = Counter(result.outcome for result in chosen)
            numbers = [len(chosen), *(outcomes[key] for key in ("killed", "timed out", "survived"))]
            numbers += [sum(result.is_cut for result in chosen)]
            share = 1.0 - outcomes["survived"] / max(len(chosen), 1)
            rows.append(f"| {name} | " + " | ".join(map(str, numbers)) + f" | {share:.0%} |")
        notes = [f"fails in any case, not used: {test}" for test in sorted(self.broken)]
        return "\n".join([*rows, *notes])


def chosen_mutants(tree: Tree, options: argparse.Namespace) -> list[Mutant]:
    """Return the sample, the packages taking turns; or the survivors of an earlier result that still exist."""
    mutants = tree.mutants()
    if unknown := sorted(set(options.package) - mutants.keys()):
        raise SystemExit(f"mutants: --package: expected one of {', '.join(sorted(mutants))}; got {', '.join(unknown)}")
    names = [name for name in sorted(mutants) if name in options.package or not options.package]
    if not options.rerun:
        rows = [draw(mutants[name], options.count, random.Random(f"{options.seed} {name}")) for name in names]
        return [row[k] for k in range(options.count) for row in rows if k < len(row)]
    earlier = [item for item in json.loads(options.rerun.read_text())["results"] if item["outcome"] == "survived"]
    found = []
    for old in [Mutant(**item["mutant"]) for item in earlier]:
        same = [new for name in names for new in mutants[name] if new.key == old.key]
        same.sort(key=lambda new: (new.path != old.path, Path(new.path).name != Path(old.path).name, new.line))
        found += same[:1]
        if not same and not options.package:
            say(f"gone       {old.path}:{old.line}  {old.kind}: {old.change}\n                 {old.text}")
    return found


def say(text: str) -> None:
    """Write lines to the standard output at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def main() -> int:
    """Draw mutants, run them, print what became of each and the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=6, help="mutants of each package (6)")
    parser.add_argument("--package", action="append", default=[], help="only this one; may be repeated")
    parser.add_argument("--jobs", type=int, default=1, help="mutants at the same time, each in its own copy")
    parser.add_argument("--limit", type=float, default=120.0, help="seconds for the tests of one mutant (120)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the results there, after each mutant")
    parser.add_argument("--rerun", type=Path, metavar="JSON", help="repeat only the survivors of this earlier result")
    parser.add_argument("--list", action="store_true", help="print the sample, run nothing")
    options = parser.parse_args()
    tree = Tree(ROOT)
    sample = chosen_mutants(tree, options)
    if options.list:
        say("\n".join(f"{item.path}:{item.line}  {item.kind}: {item.change}\n    {item.text}" for item in sample))
        return 0
    report = Report(options.seed, options.json)
    with tempfile.TemporaryDirectory(prefix="mutants_") as name, ThreadPoolExecutor(options.jobs) as workers:
        stages: Queue[Stage] = Queue()
        for number in range(options.jobs):
            (folder := Path(name) / str(number)).mkdir()
            stages.put(Stage(ROOT, tree.packages, folder, report.broken))

        def judge(mutant: Mutant) -> Result:
            path = PurePosixPath(mutant.path)
            result, stage = Result(package_of(path), mutant), stages.get()
            try:
                stage.judge(result, tree.tests_of(path), options.limit)
            finally:
                stages.put(stage)
            return result

        for result in workers.map(judge, sample):
            report.add(result)
    say(f"\n{report.table()}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
