"""`sphere_nav map` killed at random moments, and on disks that are full at random moments: what stays.

Each key sphere is noted, by its stamp, when the writer says that it is written. After the end all that were noted but
the few since the last graph must be in the map that `map-verify --salvage` makes of the remains.
Processes are forked from this one, which has imported what they need.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from sphere_nav_msgs.msg import AugmentedSphere

from benchmarks.machine import describe
from benchmarks.report import Bound, Report, Table
from benchmarks.room import render
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.ros.bags import BagWriter
from sphere_nav.ros.conversions import sphere_to_message
from sphere_nav.ros.maps.reader import open_map
from sphere_nav.ros.maps.writer import GRAPH_EVERY, MapWriter
from sphere_nav.spheres.sphere import Sphere
from sphere_nav_tools.cli.main import main

HELP = "map killed at random moments, and on full disks: key spheres read back"
CAMERA = Spherical(128, 64)
NUM_INSTANTS, STEP_NS = 16, 200_000_000
SETTINGS = ("--set", "mapper.key.max_parallax_whole=0.02")  # most spheres become key spheres
PATIENCE_S = 300.0
SLACK_BYTES = 1 << 16


@dataclass
class Tally:
    """What became of some runs."""

    num_runs: int = 0
    num_ended: int = 0  # before they were done
    num_written: int = 0
    num_read: int = 0
    num_lost: int = 0  # more than those since the last graph
    num_told: int = 0  # that said in one line what stays


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--kills", type=int, default=100, help="runs that are killed (%(default)s)")
    parser.add_argument("--full", type=int, default=20, help="runs whose disk is full (%(default)s)")
    parser.add_argument("--lost-jobs", type=int, default=1, help="processes of the runs (%(default)s)")
    parser.add_argument("--lost-seed", type=int, default=24, help="of the moments (%(default)s)")


def run(options: argparse.Namespace) -> Report:
    """Map a drive in a room as a whole, then again and again to an end."""
    kills, full = (5, 2) if options.quick else (options.kills, options.full)
    words = ", ".join(map(str, (kills, full, options.lost_jobs, options.lost_seed)))
    code = f"from benchmarks.nothing_lost import measure; measure({words})"  # a process that has no threads yet
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    done = subprocess.run([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, env=environment, check=True)
    found = json.loads(done.stdout.splitlines()[-1])
    killed, filled = Tally(**found["killed"]), Tally(**found["filled"])
    report = Report("nothing_lost", notes=[describe(options.threads), __doc__ or ""])
    rows = [
        (name, *(str(value) for value in vars(tally).values()))
        for name, tally in (("kill -9", killed), (found["how"], filled))
    ]
    columns = ("end", "runs", "ended before", "key spheres written", "read back", "lost", "told how")
    title = f"{NUM_INSTANTS} instants, {found['seconds']:.1f} s, jobs {options.lost_jobs}"
    report.tables.append(Table(title, columns, rows))
    for name, tally in (("kill -9", killed), ("full disk", filled)):
        report.bounds.append(Bound(f"{name}: key spheres lost that a graph was written after", 0, tally.num_lost, ""))
    report.bounds.append(Bound("full disk: ends without a line", 0, filled.num_ended - filled.num_told, ""))
    return report


def measure(kills: int, full: int, jobs: int, seed: int) -> None:
    """Print what became of the runs as JSON."""
    rng, killed, filled, how = np.random.default_rng(seed), Tally(), Tally(), ""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        _draw(folder / "bag")
        words = ["map", str(folder / "bag"), "-o", "map", *SETTINGS, "--jobs", str(jobs)]
        for name in ("first", "whole"):  # the first one fills the caches
            (folder / name).mkdir()
            begun = time.monotonic()
            if wait(start(folder / name, words)):
                raise ValueError(f"map: expected exit status 0, found {(folder / name / 'said').read_text()[-500:]}")
        seconds, whole = time.monotonic() - begun, folder / "whole" / "map" / "map.mcap"
        for number in range(kills):
            _kill(folder / f"killed_{number}", words, rng.uniform(0.0, seconds), killed)
            print(f"kill {number + 1}: {killed}", file=sys.stderr)
        for number in range(full):
            how = _fill(folder / f"full_{number}", words, rng.uniform(0.05, 1.3), whole, filled)
            print(f"full {number + 1}: {filled}", file=sys.stderr)
    print(json.dumps({"killed": vars(killed), "filled": vars(filled), "how": how, "seconds": seconds}))


def _draw(path: Path) -> None:
    """Write a bag of spheres with range on a way through a room."""
    with BagWriter(path) as bag:
        for number in range(NUM_INSTANTS):
            image, range_m = render(CAMERA, SE3.from_planar(-1.5 + 0.12 * number, 0.2, 0.02 * number))
            stamp_ns = STEP_NS * (number + 1)
            bag.add_topic("sphere", AugmentedSphere)
            bag.write("sphere", sphere_to_message(Sphere(image, range_m, CAMERA, stamp_ns), "sphere_link"), stamp_ns)


def start(folder: Path, words: list[str], prepare: Callable[[], object] = lambda: None) -> int:
    """Fork a process that runs a command in a folder; it notes there what it has written, and what it says."""
    pid = os.fork()
    if pid:
        return pid
    status = 99
    try:
        os.chdir(folder)
        said = os.open("said", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        noted = os.open("../noted_" + folder.name, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        os.dup2(said, 1)
        os.dup2(said, 2)
        add = MapWriter.add

        def add_and_note(self: MapWriter, node: Any, sphere: Any) -> None:
            add(self, node, sphere)
            os.write(noted, b"%d\n" % node.stamp_ns)

        MapWriter.add = add_and_note  # type: ignore[method-assign]
        prepare()
        status = main(words)
    finally:
        os._exit(status)


def wait(pid: int, seconds: float = PATIENCE_S) -> int:
    """Return the exit status; kill the process after some time."""
    until = time.monotonic() + seconds
    while os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None:
        if time.monotonic() > until:
            os.kill(pid, signal.SIGKILL)
        time.sleep(0.005)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])


def _kill(folder: Path, words: list[str], after_s: float, tally: Tally) -> None:
    folder.mkdir()
    tally.num_ended += wait(start(folder, words), after_s) < 0
    _judge(folder, tally)


def _fill(folder: Path, words: list[str], share: float, whole: Path, tally: Tally) -> str:
    """Map on a disk that takes a share of what a run needs; return how it was limited."""
    folder.mkdir()
    size = round(share * 2 * whole.stat().st_size) + SLACK_BYTES
    options = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)]
    is_mounted = subprocess.run(options, capture_output=True, check=False).returncode == 0
    limit = round(share * whole.stat().st_size)
    lower = (lambda: None) if is_mounted else (lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)))
    try:
        status = wait(start(folder, words, lower))
        tally.num_ended += status != 0
        tally.num_told += status == 1 and b"stay" in (folder / "said").read_bytes()
        if is_mounted:
            subprocess.run(["mount", "-o", "remount,size=1g", str(folder)], capture_output=True, check=True)
        _judge(folder, tally)
    finally:
        if is_mounted:
            subprocess.run(["umount", str(folder)], capture_output=True, check=False)
    return "a full tmpfs" if is_mounted else "RLIMIT_FSIZE"


def _judge(folder: Path, tally: Tally) -> None:
    """Read back what was written."""
    noted = folder.parent / f"noted_{folder.name}"
    written = set(map(int, noted.read_text().split())) if noted.exists() else set()
    tally.num_runs += 1
    tally.num_written += len(written)
    left = next((name for name in ("map.drive", "map.drive.partial") if (folder / name).exists()), "")
    num_read = len(written) if (folder / "map").exists() else 0
    if not num_read and left and wait(start(folder, ["map-verify", left, "--salvage", "mended"])) == 0:
        with open_map(folder / "mended") as reader:
            num_read = len(written & {reader.load_sphere(node.id).stamp_ns for node in reader.graph})
    tally.num_read += num_read
    tally.num_lost += max(len(written) - num_read - GRAPH_EVERY + 1, 0)
