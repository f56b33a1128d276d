"""Wrong inputs for every reader of files: each must be refused in one line, or be right."""

from __future__ import annotations

import argparse
import mmap
import os
import resource
import signal
import struct
import tempfile
import time
import traceback
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.abuse.fuzz_targets import Target, make_targets
from benchmarks.report import Bound, Headline, Report, Table
from sphere_nav.ros.service import one_line

BATCH = 400  # inputs a child
SECONDS, PATIENCE = 10, 6  # of the processor for one input; times as many by the clock, on a busy machine
MEMORY = 1 << 30  # bytes that a child may ask for beyond what it starts with
STATE = struct.Struct("<qqqq")  # next input, accepted, refused, failures


@dataclass
class Outcome:
    """What became of the inputs of one target."""

    name: str
    num_inputs: int = 0
    num_accepted: int = 0
    num_refused: int = 0
    seconds: float = 0.0
    failures: list[str] = field(default_factory=list)


def run(options: argparse.Namespace) -> Report:
    """Try so many inputs, evenly over all targets by their cost."""
    count = 1000 if options.size == "quick" else 20_000
    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as folder:
        outcomes = fuzz(make_targets(Path(folder)), Path(folder), options.seed, count)
    report = Report("fuzz")
    rows = [(o.name, str(o.num_inputs), str(o.num_accepted), str(o.num_refused), f"{o.seconds:.0f}") for o in outcomes]
    report.tables.append(Table("Inputs", ("target", "inputs", "accepted", "refused", "s"), rows))
    failures = [(failure.replace("|", "/"),) for outcome in outcomes for failure in outcome.failures]
    if failures:
        report.tables.append(Table("Failures", ("what",), failures[:200]))
    what = f"crashes, hangs, gigabytes, wrong results of {sum(o.num_inputs for o in outcomes)} inputs"
    told = Headline("robustness", f"{len(outcomes)} readers of files")
    report.bounds.append(Bound(what, 0, len(failures), "", headline=told))
    return report


def fuzz(targets: list[Target], folder: Path, seed: int, count: int) -> list[Outcome]:
    """Return the outcomes of `count` inputs; the same seed gives the same inputs."""
    weights = np.array([target.weight for target in targets])
    shares = np.ceil(count * weights / weights.sum()).astype(int)
    outcomes = []
    for target, share in zip(targets, shares.tolist(), strict=True):
        outcome, started = Outcome(target.name), time.monotonic()
        while outcome.num_inputs < share:
            _run_child(target, folder, seed, outcome, min(outcome.num_inputs + BATCH, share))
        outcome.seconds = time.monotonic() - started
        outcomes.append(outcome)
    return outcomes


def _run_child(target: Target, folder: Path, seed: int, outcome: Outcome, end: int) -> None:
    """Let a child try inputs up to `end`; where it dies, the input that it died of is a failure."""
    with mmap.mmap(-1, STATE.size) as state, tempfile.TemporaryFile() as log:
        state[:] = STATE.pack(outcome.num_inputs, 0, 0, 0)
        child = os.fork()
        if child == 0:
            try:
                _limit()
                _try_inputs(target, folder, seed, state, end, log.fileno())
            finally:
                os._exit(0)
        _, status = os.waitpid(child, 0)
        number, accepted, refused, _ = STATE.unpack(state[:])
        log.seek(0)
        outcome.failures += log.read().decode("utf-8", "replace").splitlines()
    if os.WIFSIGNALED(status):
        name = signal.Signals(os.WTERMSIG(status)).name
        what = f"no end after {SECONDS} s" if name in ("SIGALRM", "SIGPROF") else f"ended by {name}"
        outcome.failures.append(f"{target.name}, input {number}: {what}")
        number += 1
    outcome.num_inputs, outcome.num_accepted = max(number, outcome.num_inputs + 1), outcome.num_accepted + accepted
    outcome.num_refused += refused


def _limit() -> None:
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    os.dup2(null, 2)


def _try_inputs(target: Target, folder: Path, seed: int, state: mmap.mmap, end: int, log: int) -> None:
    first, accepted, refused, failed = STATE.unpack(state[:])
    for number in range(first, end):
        signal.setitimer(signal.ITIMER_PROF, SECONDS)
        signal.setitimer(signal.ITIMER_REAL, PATIENCE * SECONDS)
        rng = np.random.default_rng([seed, target.key, number])
        try:
            target.attempt(rng, folder)
            accepted += 1
        except (ValueError, OSError) as error:
            refused += 1
            if "\n" in str(error):
                failed += 1
                os.write(log, f"{target.name}, input {number}: expected one line, found {one_line(error)!r}\n".encode())
        except BaseException as error:
            failed += 1
            place = traceback.extract_tb(error.__traceback__)[-1]
            what = f"{type(error).__name__} at {Path(place.filename).name}:{place.lineno}: {error!r:.100}"
            os.write(log, f"{target.name}, input {number}: {what}\n".encode())
        state[:] = STATE.pack(number + 1, accepted, refused, failed)
    signal.setitimer(signal.ITIMER_PROF, 0)
    signal.setitimer(signal.ITIMER_REAL, 0)
