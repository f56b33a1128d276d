"""`python scripts/mutants.py`: put faults into the code on purpose and count how many the tests notice.

A mutant is the product with one small fault: a sign, a bound, a unit, two swapped arguments, a check that is gone, a
constant twice as large, `and` for `or`, `min` for `max`, a `not` that is gone. Of every package some are drawn by
`--seed`, one of each kind in turn, and each runs against the tests of its own package alone:

1. the test that mirrors the module and those that import it, for a ROS shell also those of its node in test/nodes,
   for parameters also those that hold for the parameters of all packages, for constants also those of their users;
2. if they pass, the rest of the package's tests, those nearest to the module first, until they have taken `--limit`
   seconds of CPU; not with `--near`, which is quicker: `--rerun` then repeats the survivors with all tests.

Everything happens in a copy, with the copy's packages in front of the installed ones. A kill counts if the failing
test passes without the mutant; a time-out if the test that was running takes too long by itself, and only with the
mutant. CPU time is what counts, and where a test waits without end, IDLE times as much time in which nothing of it was
ready to run: other work on the machine makes no time-out. Mutants that change no result (`<` and `<=` of two floats)
are not sorted out: they count as survivors. Recordings are used where SPHERE_NAV_DATA names them. Run it with the
environment's python.
"""

from __future__ import annotations

import argparse
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
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path, PurePosixPath
from queue import Queue
from typing import Any

from checkout import Tree, dotted, package_of
from mutations import Mutant, apply, draw, mutants_of, numeric_constants

ROOT = Path(__file__).resolve().parents[1]
MARGIN = " " * 17
POLL = 0.5  # how often the tests are looked at, s
IDLE = 5  # times the limit of CPU time that tests may wait: those of nodes wait longer than they compute
SKIPPED = {"kernels", "warm_up", "plot", "plots", "figure", "figures"}  # a name of a module, or one of its words


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
        text = f"{self.outcome:9} {self.seconds:4.0f} s  {self.mutant.where}: {self.mutant.change}"
        cut = "  (not all tests run)" if self.is_cut else ""
        return text + (f"{cut}\n{MARGIN}{self.mutant.text}" if self.outcome == "survived" else f"  [{self.by}]")


@dataclass
class Run:
    """How a run of pytest ended: `passed`, `failed` or `timed out`, the test that failed or was running, CPU time."""

    outcome: str
    test: str = ""
    seconds: float = 0.0


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

    def judge(self, result: Result, tests: tuple[list[str], list[str]], limit: float, *, is_near: bool = False) -> None:
        """Run a mutant against its tests, or only those near to its module, and fill in what became of it."""
        steps = [files for files in tests if files]
        for files in steps:
            remaining = limit - result.seconds
            run = self._run_sound(result.mutant, files, remaining) if remaining > 0 else Run("timed out")
            result.seconds = round(result.seconds + run.seconds, 1)
            if run.outcome == "timed out" and not self._is_slowed(result.mutant, run.test, limit / 2):
                result.is_cut = True
                break
            if run.outcome != "passed":
                result.outcome, result.by = run.outcome.replace("failed", "killed"), run.test
                break
            if is_near and len(steps) > 1:
                result.is_cut = True
                break

    def _run_sound(self, mutant: Mutant, files: list[str], limit: float) -> Run:
        """Run tests with a mutant, without those that fail in any case."""
        while files := [name for name in files if name not in self.broken]:
            run = self.run(files, limit, mutant)
            if run.outcome != "failed" or self._is_sound(run.test, limit):
                return run
            self.broken.add(run.test)
        return Run("passed")

    def _is_sound(self, test: str, limit: float) -> bool:
        """Whether a test passes, or its file can be imported, without a mutant, which may have named a parameter."""
        tries = dict.fromkeys((test, test.partition("[")[0]))
        if test not in self._sound and any(
            self.run([item], max(limit, 60.0), is_collecting="::" not in item).outcome == "passed" for item in tries
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
                code, seconds = self._wait(process, limit)
            finally:
                self._end_processes()
                process.wait()
                if mutant:
                    self._write(mutant.path, original, None)
        if code in (0, 5):  # 5: all tests deselected
            return Run("passed", seconds=seconds)
        lines = log.read_text(errors="replace").splitlines()
        failed = [line.split(" ", 1)[1].split(" - ")[0] for line in lines if line.startswith(("FAILED ", "ERROR "))]
        running = [line.split(" ")[0] for line in lines if line.startswith("test/") and "::" in line]
        return Run("timed out" if code is None else "failed", (failed or running or tests)[-1], seconds)

    def _wait(self, process: subprocess.Popen, limit: float) -> tuple[int | None, float]:
        """Wait for the end of a process; return its code, None where it takes too long, and its CPU time in seconds."""
        seconds = idle = 0.0
        while seconds < limit and idle < IDLE * limit:
            begin = time.monotonic()
            try:
                return process.wait(POLL), seconds
            except subprocess.TimeoutExpired:
                folders = list(self._processes())
                seconds = max(seconds, sum(map(cpu_seconds, folders)))
                if not any(map(is_ready, folders)):
                    idle += time.monotonic() - begin
        return None, seconds

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
        for folder in self._processes():
            with suppress(OSError):  # it ended by itself
                os.kill(int(folder.name), signal.SIGKILL)

    def _processes(self) -> Iterator[Path]:
        """Yield the folders in /proc of the processes that were started in here."""
        mark = f"STAGE={self.environment['STAGE']}".encode()
        for folder in Path("/proc").glob("[0-9]*"):
            with suppress(OSError):  # it ended, or is not ours
                if mark in (folder / "environ").read_bytes().split(b"\0"):
                    yield folder


def cpu_seconds(folder: Path) -> float:
    """Return the CPU time of a process and of its children that have ended, in seconds, by its folder in /proc."""
    try:
        fields = (folder / "stat").read_text().rpartition(")")[2].split()
    except OSError:  # it has ended
        return 0.0
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")


def is_ready(folder: Path) -> bool:
    """Whether a process has a thread that runs, or would on a machine with nothing else to do, by its folder in /proc.

    What waits for a disk, or was stopped from outside, counts as well.
    """
    for path in folder.glob("task/*/stat"):
        with suppress(OSError):  # the thread has ended
            if path.read_text().rpartition(")")[2].split()[0] in "RDT":
                return True
    return False


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

    def survivors(self) -> str:
        """Return those that no test noticed, by kind and place."""
        found = [result for result in self.results if result.outcome == "survived"]
        found.sort(key=lambda result: (result.mutant.kind, result.mutant.path, result.mutant.line))
        return "\n".join(result.line() for result in found)

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


def all_mutants(tree: Tree) -> dict[str, list[Mutant]]:
    """Return the mutants of the product by package."""
    constants = numeric_constants(module for _, _, module in tree.texts())
    found: dict[str, list[Mutant]] = {}
    for path, text, _ in tree.texts():
        if not SKIPPED & {path.stem, *path.stem.split("_")}:
            found.setdefault(package_of(path), []).extend(mutants_of(text, str(path), constants))
    return found


def sample_of(mutants: dict[str, list[Mutant]], seed: int, count: int) -> list[Result]:
    """Return a sample that has still to run, the packages taking turns."""
    rows = [(name, draw(items, count, random.Random(f"{seed} {name}"))) for name, items in sorted(mutants.items())]
    return [Result(name, row[k]) for k in range(count) for name, row in rows if k < len(row)]


def earlier_results(mutants: dict[str, list[Mutant]], items: list[dict[str, Any]]) -> tuple[list[Result], list[Mutant]]:
    """Return earlier results of the mutants that still exist, wherever their line is now; and the others."""
    found, gone = [], []
    for item in items:
        old = Mutant(**item["mutant"])
        same = [(name, new) for name, row in mutants.items() for new in row if new.key == old.key]
        if same:
            package, new = min(same, key=lambda pair: pair[1].distance(old))
            found.append(Result(**(item | {"package": package, "mutant": new})))
        else:
            gone.append(old)
    return found, gone


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
    parser.add_argument("--limit", type=float, default=120.0, help="seconds of CPU for the tests of one mutant (120)")
    parser.add_argument("--near", action="store_true", help="quick: only tests that mirror or import the module")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the results there, after each mutant")
    parser.add_argument(
        "--rerun", type=Path, metavar="JSON", help="repeat the survivors of an earlier result, keep the rest"
    )
    parser.add_argument("--list", action="store_true", help="print the sample, run nothing")
    options = parser.parse_args()
    tree = Tree(ROOT)
    mutants = all_mutants(tree)
    if unknown := sorted(set(options.package) - mutants.keys()):
        parser.error(f"--package: expected one of {', '.join(sorted(mutants))}; got {', '.join(unknown)}")
    if options.package:
        mutants = {name: mutants[name] for name in options.package}
    report = Report(options.seed, options.json)
    if options.rerun:
        earlier = json.loads(options.rerun.read_text(encoding="utf-8"))
        found, gone = earlier_results(mutants, earlier["results"])
        sample = [Result(item.package, item.mutant) for item in found if item.outcome == "survived"]
        report = Report(earlier["seed"], options.json, results=[item for item in found if item.outcome != "survived"])
        for item in gone:
            say(f"gone from here: {item.where}: {item.change}\n{MARGIN}{item.text}")
    else:
        sample = sample_of(mutants, options.seed, options.count)
    if options.list:
        say("\n".join(f"{item.mutant.where}: {item.mutant.change}\n{MARGIN}{item.mutant.text}" for item in sample))
        return 0
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends what it started, removes the copies
    with tempfile.TemporaryDirectory(prefix="mutants_") as name, ThreadPoolExecutor(options.jobs) as workers:
        stages: Queue[Stage] = Queue()
        for number in range(options.jobs):
            (folder := Path(name) / str(number)).mkdir()
            stages.put(Stage(ROOT, tree.packages, folder, report.broken))

        def judge(result: Result) -> Result:
            stage = stages.get()
            try:
                tests = tree.tests_of(PurePosixPath(result.mutant.path), result.mutant.text)
                stage.judge(result, tests, options.limit, is_near=options.near)
            finally:
                stages.put(stage)
            return result

        try:
            for result in workers.map(judge, sample):
                report.add(result)
        finally:
            workers.shutdown(cancel_futures=True)
    say(f"\n{report.survivors()}\n\n{report.table()}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
