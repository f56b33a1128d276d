"""Wrong inputs for every reader of files: each must be refused in one line, or be right."""

from __future__ import annotations

import argparse
import mmap
import os
import resource
import signal
import struct
import tempfile
import traceback
import zlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.abuse.fuzz_samples import Samples
from benchmarks.abuse.mutations import attack_texts, mutate_bytes
from benchmarks.report import Bound, Headline, Report, Table
from mcl_depth.geometry.files import read_geometry
from path_follower.params import FollowerParams
from path_follower.path_files import read_path
from path_follower.routes.network_file import read_network
from sphere_nav.geometry.files.foreign_rig import read_foreign_rig
from sphere_nav.geometry.files.rig_file import read_rig
from sphere_nav.geometry.trajectory import read_tum
from sphere_nav.ros.bags.mcap_file import whole_messages
from sphere_nav.ros.bags.reader import BagReader
from sphere_nav.ros.bags.streams import read_streams
from sphere_nav.ros.camera.mounting import read_mounting
from sphere_nav.ros.maps.check import salvage_map
from sphere_nav.ros.maps.reader import MapReader, open_map
from sphere_nav.ros.service import one_line
from sphere_nav.spheres.graph import KeySphere
from sphere_nav_tools.offline.importing import files

Readers = dict[str, tuple[Path, Callable[[Path], Any]]]
BATCH = 400  # inputs a child
SECONDS, PATIENCE = 10, 6  # of the processor for one input; times as many by the clock, on a busy machine
MEMORY = 1 << 30  # bytes that a child may ask for beyond what it starts with
STATE = struct.Struct("<qqq")  # next input, accepted, refused


@dataclass(frozen=True)
class Target:
    """One reader: `attempt` makes an input and tries it; ValueError or OSError refuse, AssertionError is a mistake."""

    name: str
    attempt: Callable[[np.random.Generator, Path], None]
    weight: float = 1.0  # share of the inputs; less for what takes long

    @property
    def key(self) -> int:
        """A number of its own for the seed."""
        return zlib.crc32(self.name.encode())


def make_targets(folder: Path) -> list[Target]:
    """Return all targets; valid samples are made in a folder first."""
    samples = Samples(folder)
    readers = _readers(samples)
    slow = {name for name, (path, _) in readers.items() if path.suffix == ".laz"}
    targets = [_file_target(name, *pair, weight=0.02 if name in slow else 1.0) for name, pair in readers.items()]
    targets += [*_bag_targets(samples)]
    return [*targets, Target("attack: characters and nesting", partial(attack_texts, readers), 2.0)]


def _file_target(name: str, sample: Path, read: Callable[[Path], Any], weight: float = 1.0) -> Target:
    data = sample.read_bytes()

    def attempt(rng: np.random.Generator, folder: Path) -> None:
        path = folder / f"wrong{sample.suffix}"
        path.write_bytes(mutate_bytes(data, rng))
        check(read(path))

    return Target(name, attempt, weight)


def check(found: Any) -> None:
    """Raise AssertionError where what was accepted holds absurd numbers; NaN and infinity have a meaning in ranges."""
    if isinstance(found, dict):
        found = list(found.values())
    if isinstance(found, list | tuple):
        for item in found[:50]:
            check(item)
        return
    for name in ("matrix", "points", "positions", "vertices", "coefficients", "x", "y"):
        values = getattr(found, name, None)
        if isinstance(values, np.ndarray) and not callable(values):
            limit = np.nanmax(np.abs(values), initial=0.0) if name != "coefficients" else 0.0
            assert limit <= 1e15, f"accepted numbers up to {limit:g} in {type(found).__name__}.{name}"
            assert name == "coefficients" or np.all(np.isfinite(values)), f"accepted {name} that are not finite"


def _readers(samples: Samples) -> Readers:
    """Return the readers of files that are no bag, each with a valid file."""
    params = FollowerParams()

    def read_placed(path: Path) -> Any:
        return read_foreign_rig([path]).cameras

    readers: Readers = {
        "rig": (samples.rig, lambda path: [camera.camera for camera in read_rig(path).cameras]),
        "kalibr": (samples.kalibr, read_placed),
        "opencv": (samples.opencv, read_placed),
        "tum": (samples.tum, read_tum),
        "path tum": (samples.tum, lambda path: read_path(path, params)),
        "path csv": (samples.path_csv, lambda path: read_path(path, params)),
        "table": (samples.table, lambda path: files.read_numbers(path, 4)),
        "pose": (samples.table, files.read_pose),
        "mounting": (samples.mounting, lambda path: read_mounting(str(path))),
        "routes": (samples.routes, read_network),
        "image png": (samples.png, files.read_image),
        "image jpg": (samples.jpg, files.read_image),
        "depth png": (samples.depth, files.read_meters),
    }
    geometry = {f"geometry {path.stem}{path.suffix}": (path, read_geometry) for path in samples.geometry}
    return readers | geometry


def _bag_targets(samples: Samples) -> list[Target]:
    messages, spheres = set(_messages(samples.bag)), samples.spheres
    sqlite, *ros1 = samples.foreign_bags

    def read_bag(path: Path) -> None:
        with BagReader(path, is_empty_allowed=True) as bag:
            found = [(topic, stamp, bytes(data)) for topic, stamp, data in bag.raw()]
        assert set(found) <= messages, "accepted messages that were never written"

    def read_salvage(path: Path) -> None:
        found = [(channel.topic, item.log_time, item.data) for _, channel, item in whole_messages(path)]
        assert set(found) <= messages, "salvaged messages that were never written"

    def read_map(path: Path) -> None:
        with open_map(path) as reader:
            _check_spheres(_load_all(reader), spheres)

    def read_made(make: Callable[[Path, Path], object], path: Path) -> None:
        target = path.with_name(f"saved{abs(hash(path.read_bytes()))}")
        make(path, target)
        with open_map(target) as reader:
            _check_spheres(_load_all(reader), spheres)
        for file in target.iterdir():
            file.unlink()
        target.rmdir()

    def read_foreign_bag(path: Path) -> None:
        with BagReader(path, is_empty_allowed=True) as bag:
            read_streams(bag)
            list(bag.raw())

    return [
        _file_target("bag", samples.bag, read_bag),
        _file_target("bag, salvage", samples.bag, read_salvage),
        _file_target("bag, plain", samples.plain_bag, lambda path: list(_messages(path))),
        _file_target("bag, sqlite3", sqlite, read_foreign_bag, 0.5),
        *(_file_target(f"bag, ROS 1 {path.stem}", path, read_foreign_bag, 0.5) for path in ros1),
        _file_target("map", samples.map / "map.mcap", read_map),
        _file_target("map, salvage", samples.map / "map.mcap", partial(read_made, salvage_map), 0.3),
    ]


def _messages(path: Path) -> Iterable[tuple[str, int, bytes]]:
    with BagReader(path, is_empty_allowed=True) as bag:
        for topic, stamp, data in bag.raw():
            yield topic, stamp, bytes(data)


def _load_all(reader: MapReader) -> list[KeySphere]:
    return [replace(node, sphere=reader.load_sphere(node.id)) for node in reader.graph]


def _check_spheres(graph: Iterable[Any], spheres: dict[int, Any]) -> None:
    for node in graph:
        assert node.id in spheres, f"accepted a key sphere {node.id} that was never written"
        assert np.array_equal(node.sphere.image, spheres[node.id].image), "accepted another picture"


@dataclass
class Outcome:
    """What became of the inputs of one target."""

    name: str
    num_inputs: int = 0
    num_accepted: int = 0
    num_refused: int = 0
    failures: list[str] = field(default_factory=list)


def run(options: argparse.Namespace) -> Report:
    """Try so many inputs, evenly over all targets by their cost."""
    count = 1000 if options.size == "quick" else 20_000
    outcomes = fuzz(make_targets(options.folder), options.folder, options.seed, count)
    report = Report("fuzz")
    rows = [(o.name, str(o.num_inputs), str(o.num_accepted), str(o.num_refused)) for o in outcomes]
    report.tables.append(Table("Inputs", ("target", "inputs", "accepted", "refused"), rows))
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
        outcome = Outcome(target.name)
        while outcome.num_inputs < share:
            _run_child(target, folder, seed, outcome, min(outcome.num_inputs + BATCH, share))
        outcomes.append(outcome)
    return outcomes


def _run_child(target: Target, folder: Path, seed: int, outcome: Outcome, end: int) -> None:
    """Let a child try inputs up to `end`; where it dies, the input that it died of is a failure."""
    with mmap.mmap(-1, STATE.size) as state, tempfile.TemporaryFile() as log:
        state[:] = STATE.pack(outcome.num_inputs, 0, 0)
        child = os.fork()
        if child == 0:
            try:
                _limit()
                _try_inputs(target, folder, seed, state, end, log.fileno())
            finally:
                os._exit(0)
        _, status = os.waitpid(child, 0)
        number, accepted, refused = STATE.unpack(state[:])
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
    first, accepted, refused = STATE.unpack(state[:])
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
                os.write(log, f"{target.name}, input {number}: expected one line, found {one_line(error)!r}\n".encode())
        except BaseException as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            what = f"{type(error).__name__} at {Path(place.filename).name}:{place.lineno}: {error!r:.100}"
            os.write(log, f"{target.name}, input {number}: {what}\n".encode())
        state[:] = STATE.pack(number + 1, accepted, refused)
    signal.setitimer(signal.ITIMER_PROF, 0)
    signal.setitimer(signal.ITIMER_REAL, 0)
