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
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from sphere_nav_msgs.msg import AugmentedSphere

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
FULL = "full disk"  # a limit on the size of a file, which looks the same to who writes


@dataclass
class Tally:
    """What became of some runs."""

    num_runs: int = 0
    num_ended: int = 0  # before they were done
    num_written: int = 0
    num_read: int = 0
    num_lost: int = 0  # more than those since the last graph
    num_told: int = 0  # that said in one line what stays


def run(options: argparse.Namespace) -> Report:
    """Map a drive in a room as a whole, then again and again to an end."""
    kills, full = (3, 1) if options.size == "quick" else (100, 20)
    code = (
        f"from benchmarks.abuse.nothing_lost import measure; measure({kills}, {full}, {options.seed})"  # no threads yet
    )
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    done = subprocess.run([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, env=environment, check=True)
    found = json.loads(done.stdout.splitlines()[-1])
    report, rows = Report("nothing_lost", notes=[__doc__ or ""]), []
    for name, tally in found.items():
        rows.append((name, *map(str, tally.values())))
        what = f"{name}: key spheres lost that a graph was written after"
        report.bounds.append(Bound(what, 0, tally["num_lost"], ""))
    full_disk = found[FULL]
    report.bounds.append(Bound(f"{FULL}: ends without a line", 0, full_disk["num_ended"] - full_disk["num_told"], ""))
    columns = ("end", "runs", "ended before", "key spheres written", "read back", "lost", "told how")
    report.tables.append(Table(f"{NUM_INSTANTS} instants", columns, rows))
    return report


def measure(kills: int, full: int, seed: int) -> None:
    """Print what became of the runs as JSON."""
    rng, killed, filled = np.random.default_rng(seed), Tally(), Tally()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        _draw(folder / "bag")
        words = ["map", str(folder / "bag"), "-o", "map", *SETTINGS]
        for name in ("first", "whole"):  # the first one fills the caches
            (folder / name).mkdir()
            begun = time.monotonic()
            if wait(start(folder / name, words)):
                raise ValueError(f"map: expected exit status 0, found {(folder / name / 'said').read_text()[-500:]}")
        seconds, size = time.monotonic() - begun, (folder / "whole" / "map" / "map.mcap").stat().st_size
        for number in range(kills):
            here = folder / f"killed_{number}"
            here.mkdir()
            killed.num_ended += wait(start(here, words), rng.uniform(0.0, seconds)) < 0
            _judge(here, killed)
        for number in range(full):
            here, limit = folder / f"full_{number}", round(rng.uniform(0.05, 0.95) * size)
            here.mkdir()
            status = wait(start(here, words, partial(resource.setrlimit, resource.RLIMIT_FSIZE, (limit, limit))))
            filled.num_ended += status != 0
            filled.num_told += status == 1 and b"stay" in (here / "said").read_bytes()
            _judge(here, filled)
    print(json.dumps({"kill -9": vars(killed), FULL: vars(filled)}))


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
