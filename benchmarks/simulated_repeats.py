"""A taught way of the simulator, repeated by day and night, in four seasons, among other cars: `repeats --simulated N`.

A rig is driven along the way once, its images are stitched and mapped. Then a camera drives there N times, in an order
of lights and seasons drawn by a seed, each time with other cars parked, other traffic, clouds and noise. Each drive is
localised from nowhere in the newest map. One that was not tracked well is driven again by the rig, and extends the map,
as `sphere_nav map --extend` does it. All by the commands and the simulator's own driver; `--driven K` drives K of the
kinds by the localiser over DDS at the end.

An error is that of the vehicle relative to the taught drive: what the map says of both against the truth of both.
"""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from benchmarks.end_to_end import call
from benchmarks.machine import describe
from benchmarks.report import Bound, Report, Table
from cycab_sim.params import SimParams
from cycab_sim.ros.outputs import Outputs
from cycab_sim.sensors.rigs import rig_file_text
from cycab_sim.simulator import Simulator
from dense_localizer.localizer import Localizer
from sphere_nav.geometry.trajectory import Trajectory, read_tum
from sphere_nav.params import build
from sphere_nav.ros import qos
from sphere_nav.ros.bags import BagReader, BagWriter
from sphere_nav.ros.conversions import message_to_status, stamp_ns
from sphere_nav.ros.maps.reader import FILE_NAME, open_map
from sphere_nav_tools.cli.demo.demo import OTHER_DAY, SIMULATION, TOUR, Demo
from sphere_nav_tools.offline.pose_bags import read_poses

KINDS = ("", "overcast", "autumn", "winter", "snow", "wet", "low_sun", "dusk", "night_lamps")  # "": the taught day
WAYS = (("straight", 30.0), ("two_turns", 100.0), ("tour", 490.0))  # paths of the simulator and how long they are, m
STEP_NS = 10_000_000
WELL_TRACKED = 0.99  # share of a drive's images; what is below it is driven by the rig and extends the map
MAX_CLOUDS = 0.7  # share of the sun that passing clouds take, at most
MOVING_M_S = 0.05  # slower is standing: a drive begins when the vehicle does
WRONG_M = 0.3  # off the truth
BOUNDS = {"share": 0.99, "wrong": 0.0, "size": 2.0, "cpu": 1.2, "rmse": 0.03}  # of issue and design
COLUMNS = (
    "drive",
    "kind",
    "visit",
    "images",
    "TRACKING",
    "start",
    "wrong",
    "lateral RMSE",
    "map",
    "CPU a step",
    "then",
)


@dataclass(frozen=True)
class Way:
    """What is driven: the town, and how far along the shortest path that is long enough."""

    seed: int
    length_m: float

    @property
    def path(self) -> str:
        """The shortest path that is long enough."""
        return next((name for name, length in WAYS if self.length_m <= length), WAYS[-1][0])

    def simulation(self, more: dict[str, Any]) -> dict[str, Any]:
        """Return the parameters of a drive."""
        place = dict(TOUR) if self.path == "tour" else {"path": self.path}
        return SIMULATION | {"seed": self.seed, "mode": "teach"} | place | more

    def record(self, bag: Path, more: dict[str, Any], *, by_rig: bool) -> None:
        """Drive along the way by the simulator's driver; write what its node would publish."""
        seen = {"camera.period": 0.0} if by_rig else {"rig.kind": "none"}
        simulator = Simulator(build(SimParams, self.simulation(more | seen)))
        with BagWriter(bag) as writer:
            outputs = Outputs(_Recorder(writer, simulator), simulator)  # type: ignore[arg-type]
            outputs.publish_statics()
            while simulator.driver.distance < self.length_m and not simulator.is_taught:
                for name in simulator.take_due():
                    outputs.publish(name)
                simulator.step(simulator.teach_command(), STEP_NS)
        if simulator.rig is not None:
            (bag / "rig.yaml").write_text(rig_file_text(simulator.rig, ""), encoding="utf-8")


class _Recorder:
    """Takes publishers as a node does, and writes what they send into a bag, at the simulator's time."""

    def __init__(self, bag: BagWriter, simulator: Simulator) -> None:
        self._bag, self._simulator = bag, simulator

    def add_publisher(self, topic: str, kind: type[Any], profile: Any = qos.STATE) -> _Topic:
        """Return what has `publish`; a topic on which nothing comes is not written."""
        return _Topic(lambda message: self._write(topic, kind, profile, message))

    def _write(self, topic: str, kind: type[Any], profile: Any, message: Any) -> None:
        self._bag.add_topic(topic, kind, profile)
        self._bag.write(topic, message, self._simulator.time_ns)


@dataclass(frozen=True)
class _Topic:
    publish: Callable[[Any], None]


@dataclass(frozen=True)
class Drive:
    """A repeat: its number from 1, its kind, and the how manieth of the kind it is, from 1."""

    number: int
    kind: str
    visit: int
    clouds: float

    @property
    def name(self) -> str:
        """Name of its files."""
        return f"{self.number:02d}_{self.kind or 'day'}"

    @property
    def parameters(self) -> dict[str, Any]:
        """What is not as in the teaching drive."""
        other = {"condition": self.kind, "noise_seed": 1 + self.number, "traffic.seed": self.number}
        return OTHER_DAY | other | {"season.parked": self.number, "light.clouds": self.clouds}


def draw_drives(count: int, seed: int, kinds: tuple[str, ...] = KINDS) -> list[Drive]:
    """Return the drives: every kind once in each round, in an order of its own."""
    rng = np.random.default_rng([seed, 26])
    rounds = -(-count // len(kinds))
    order = [kinds[k] for _ in range(rounds) for k in rng.permutation(len(kinds))][:count]
    clouds = [
        round(float(np.random.default_rng([seed, number]).uniform(0.0, MAX_CLOUDS)), 2) for number in range(count)
    ]
    return [
        Drive(number + 1, kind, order[: number + 1].count(kind), clouds[number]) for number, kind in enumerate(order)
    ]


@dataclass(frozen=True)
class Found:
    """How a drive was localised: images of the moving vehicle, share in TRACKING, the rest of them by reason and state.

    start_s: from the first image to the first pose in TRACKING, s (NaN: none); errors of the poses in TRACKING;
    step_ms: CPU of an image after that, of all where there is none.
    """

    num_images: int
    share: float
    start_s: float
    num_wrong: int
    lateral_rmse_m: float
    step_ms: float
    why: str = ""

    def cells(self) -> tuple[str, ...]:
        """Return them as they are printed."""
        start = "-" if np.isnan(self.start_s) else f"{self.start_s:.1f} s"
        error = "-" if np.isnan(self.lateral_rmse_m) else f"{1e3 * self.lateral_rmse_m:.1f} mm"
        return f"{self.num_images}", f"{self.share:.1%}", start, f"{self.num_wrong}", error


@dataclass(eq=False)
class Taught:
    """The teaching drive: true poses and those of the map, at the images that were mapped."""

    bag: Path
    taught: Path
    truth: Trajectory = field(init=False)
    mapped: Trajectory = field(init=False)

    def __post_init__(self) -> None:
        mapped = read_tum(self.taught)
        at, known = read_poses(self.bag, ("/ground_truth/odometry",)).at(mapped.stamps_ns)
        self.truth, self.mapped = at, mapped[known]

    def errors(self, estimate: Trajectory, truth: Trajectory) -> NDArray[np.float64]:
        """Return (N, 3) m: where the map has the vehicle less where it is, both by the nearest taught pose."""
        at, known = truth.at(estimate.stamps_ns, max_gap_ns=200_000_000)
        found = []
        for T_world, T_map in zip(at.T_map_body.matrix, estimate.T_map_body.matrix[known], strict=True):
            k = int(np.argmin(np.linalg.norm(self.truth.positions - T_world[:3, 3], axis=1)))
            true, told = (
                np.linalg.inv(one.T_map_body.matrix[k]) @ T for one, T in ((self.truth, T_world), (self.mapped, T_map))
            )
            found.append(told[:3, 3] - true[:3, 3])
        return np.array(found).reshape(-1, 3)


def localise(map_folder: Path, bag: Path, folder: Path, taught: Taught) -> Found:
    """Localise a drive by its camera from nowhere."""
    shutil.rmtree(folder, ignore_errors=True)  # of a run that was ended
    folder.mkdir()
    problem = ""
    with _noted_steps() as ends_s:
        try:
            call("localize", map_folder, bag, "-o", folder / "poses.tum", "--bag", folder / "said")
        except ValueError as error:
            problem = str(error)
    truth = read_poses(bag, ("/ground_truth/odometry",))
    with BagReader(bag) as reader:
        images = np.array([stamp_ns(item.message) for item in reader.messages(["/image_raw"])])
    states = _states(folder / "said") if (folder / "said").is_dir() else {}
    moving = images[images >= _departure_ns(truth)]
    tracked = np.array([stamp for stamp in images if states.get(stamp, ("", ""))[0] == "TRACKING"], dtype=np.int64)
    told = [states.get(stamp, ("no answer", "")) for stamp in moving]
    counts = {one: told.count(one) for one in dict.fromkeys(told) if one[0] != "TRACKING"}
    why = ", ".join(f"{number} {state} {reason}".strip() for (state, reason), number in counts.items()) or problem
    if not len(tracked):
        return Found(len(moving), 0.0, float("nan"), 0, float("nan"), _step_ms(ends_s, 0), why)
    poses = read_tum(folder / "poses.tum")
    errors = taught.errors(poses[np.isin(poses.stamps_ns, tracked)], truth)
    return Found(
        len(moving),
        float(np.isin(moving, tracked).mean()),
        float(tracked[0] - images[0]) / 1e9,
        int(np.sum(np.linalg.norm(errors, axis=1) > WRONG_M)),
        float(np.sqrt(np.mean(errors[:, 1] ** 2))),
        _step_ms(ends_s, int(tracked[0])),
        why,
    )


@contextmanager
def _noted_steps() -> Iterator[dict[int, float]]:
    """Give the CPU seconds of the process at the end of each image that a localizer takes, by the image's stamp."""
    ends_s: dict[int, float] = {}
    update = Localizer.update_rig

    def noted(self: Localizer, images: Any, stamp_ns: int, T_odom: Any = None) -> Any:
        estimate = update(self, images, stamp_ns, T_odom)
        ends_s[stamp_ns] = time.process_time()
        return estimate

    with patch.object(Localizer, "update_rig", noted):
        yield ends_s


def _step_ms(ends_s: dict[int, float], since_ns: int) -> float:
    """Return the mean CPU of an image after that of a stamp: a start, which a drive has once, is no step of it."""
    seconds = [second for stamp, second in sorted(ends_s.items()) if stamp >= since_ns]
    return 1e3 * (seconds[-1] - seconds[0]) / (len(seconds) - 1) if len(seconds) > 1 else float("nan")


def _states(bag: Path) -> dict[int, tuple[str, str]]:
    """Return state and reason by the stamp of the image."""
    with BagReader(bag) as reader:
        found = [(stamp_ns(item.message), message_to_status(item.message)) for item in reader.messages(["/status"])]
    return {stamp: (str(status.state), str(status.reason)) for stamp, status in found}


def _departure_ns(truth: Trajectory) -> int:
    """Return when the vehicle begins to move."""
    speeds = np.linalg.norm(np.diff(truth.positions, axis=0), axis=1) / (np.diff(truth.stamps_ns) * 1e-9)
    return int(truth.stamps_ns[int(np.argmax(speeds > MOVING_M_S))])


class Repeats:
    """The drives of one way, and the maps that they made; what a folder holds from a run before is not done again."""

    def __init__(self, way: Way, folder: Path, budget: str = "") -> None:
        self.way, self.folder, self._budget = way, folder, ("--budget", budget) if budget else ()
        self.maps: list[Path] = []
        self.notes: list[str] = []
        self.rows: list[tuple[str, ...]] = []
        self.found: list[tuple[Drive, Found]] = []

    def teach(self) -> None:
        """Drive and map the first day."""
        bag = self.folder / "teach"
        if not bag.is_dir():
            self.way.record(bag, {}, by_rig=True)
        self.maps.append(self.folder / "map")
        if not self.maps[0].is_dir():
            call("map", bag, "-o", self.maps[0], "--taught", self.folder / "taught.tum", *self._rig(bag))
        self.taught = Taught(bag, self.folder / "taught.tum")

    def repeat(self, drive: Drive) -> None:
        """Drive once more, localise, extend the map where that was not well."""
        bag, known = self.folder / drive.name, self.maps[-1]
        if not bag.is_dir():
            self.way.record(bag, drive.parameters, by_rig=False)
        found = self._localise(drive, known)
        then = "tracked" if found.share >= WELL_TRACKED else self._extend(drive, known)
        self.found.append((drive, found))
        size = f"{size_of(self.maps[-1]) / 1e6:.1f} MB"
        head = f"{drive.number}", drive.kind or "day", f"{drive.visit}"
        self.rows.append((*head, *found.cells(), size, f"{found.step_ms:.1f} ms", then))
        if found.why:
            self.notes.append(f"{drive.name}: {found.why}")

    def measure_step(self) -> float:
        """Return the CPU of the last drive by day in the newest map over that in the first one."""
        drive = next((drive for drive, _ in reversed(self.found) if not drive.kind), self.found[-1][0])
        newest, first = (self._localise(drive, one, "again_") for one in (self.maps[-1], self.maps[0]))
        return newest.step_ms / first.step_ms

    def drive_over_dds(self, drive: Drive) -> tuple[str, ...]:
        """Drive the way by the nodes; return kind, share driven, lateral RMSE and maximum, how it ended."""
        more = {key: value for key, value in drive.parameters.items() if key != "condition"}
        path, folder = self.way.path, self.folder / f"driven_{drive.name}"
        demo = Demo(folder, self.way.seed, path, None, more, drive.kind)
        demo.taught = self._as_taught()
        demo.drive()
        result = demo.result(demo.measure())
        told = [f"{result[name]:.3f} m" for name in ("lateral_rmse_m", "lateral_max_m")]
        return drive.kind or "day", f"{result['share_driven']:.1%}", *told, str(result["end"])

    def _as_taught(self) -> Path:
        """Return a folder with the newest map under the name that a demo expects."""
        folder = self.folder / "newest"
        folder.mkdir(exist_ok=True)
        for name, target in (("map", self.maps[-1]), ("teach", self.folder / "teach")):
            (folder / name).unlink(missing_ok=True)
            (folder / name).symlink_to(target.resolve())
        (folder / "taught.tum").write_bytes((self.folder / "taught.tum").read_bytes())
        return folder

    def _localise(self, drive: Drive, known: Path, prefix: str = "") -> Found:
        """Localise, or read what was found before."""
        folder = self.folder / f"{prefix}{drive.name}_in_{known.name}"
        if (folder / "found.json").is_file():
            return Found(**json.loads((folder / "found.json").read_text()))
        found = localise(known, self.folder / drive.name, folder, self.taught)
        (folder / "found.json").write_text(json.dumps(vars(found)))
        return found

    def _extend(self, drive: Drive, known: Path) -> str:
        """Drive the same by the rig and join that to the map, which begins where the drive does."""
        bag, made = self.folder / f"{drive.name}_rig", self.folder / f"map_{drive.name}"
        if not bag.is_dir():
            self.way.record(bag, drive.parameters, by_rig=True)
        if not made.is_dir():
            start, name = ("--start", 0.0, 0.0, 0.0), ("--experience", drive.kind or "day")
            try:
                call("map", bag, "-o", made, "--extend", known, *start, *name, *self._budget, *self._rig(bag))
            except ValueError as error:
                self.notes.append(f"{drive.name}: {error}")
                if not made.is_dir():  # else some of its spheres were not placed, and the others are in the map
                    return "refused"
        self.maps.append(made)
        return f"extended to {num_spheres(made)}"

    @staticmethod
    def _rig(bag: Path) -> tuple[object, ...]:
        return "--rig", bag / "rig.yaml"


def size_of(map_folder: Path) -> int:
    """Return the size of a map, bytes."""
    return (map_folder / FILE_NAME).stat().st_size


def num_spheres(map_folder: Path) -> int:
    """Return how many key spheres a map has."""
    with open_map(map_folder) as reader:
        return len(reader.graph)


def measure(way: Way, drives: list[Drive], folder: Path, budget: str, num_driven: int, threads: int) -> Report:
    """Teach, repeat, and judge; `budget`: of the map, as `sphere_nav map --budget` takes it."""
    repeats = Repeats(way, folder, budget)
    repeats.teach()
    for drive in drives:
        repeats.repeat(drive)
        print(" | ".join(repeats.rows[-1]), flush=True)
    title = f"{len(drives)} repeats of {way.length_m:g} m, {way.path}, town {way.seed}"
    first, last = repeats.maps[0], repeats.maps[-1]
    known = [found for drive, found in repeats.found if drive.visit > 1]
    report = Report("repeats", [Table(title, COLUMNS, repeats.rows)], notes=[*repeats.notes, describe(threads)])
    report.bounds += judge(repeats.found, size_of(last) / size_of(first), repeats.measure_step() if known else np.nan)
    report.notes.append(f"{num_spheres(first)} key spheres of the first day, {num_spheres(last)} in the end")
    if num_driven:
        latest = {drive.kind: drive for drive, _ in repeats.found}
        rows = [repeats.drive_over_dds(drive) for drive in list(latest.values())[:num_driven]]
        report.tables.append(Table("Driven over DDS", ("kind", "driven", "RMSE", "maximum", "end"), rows))
    return report


def judge(found: list[tuple[Drive, Found]], size: float, cpu: float) -> list[Bound]:
    """Return the bounds: `size`, `cpu` of the last map and a step in it over those of the first day."""
    known = [one for drive, one in found if drive.visit > 1]
    images = sum(one.num_images for one in known)
    share = sum(one.share * one.num_images for one in known) / images if images else float("nan")
    errors = [one.lateral_rmse_m for one in known if np.isfinite(one.lateral_rmse_m)]
    return [
        Bound("TRACKING from the second visit of a kind on", BOUNDS["share"], share, "", True),
        Bound(
            "the same, the worst drive", BOUNDS["share"], min((one.share for one in known), default=np.nan), "", True
        ),
        Bound("wrong in TRACKING, all drives", BOUNDS["wrong"], sum(one.num_wrong for _, one in found), ""),
        Bound("map over that of the first day", BOUNDS["size"], size, ""),
        Bound("CPU of a step by day, over that in the first map", BOUNDS["cpu"], cpu, ""),
        Bound("lateral RMSE, the worst drive", BOUNDS["rmse"], max(errors, default=np.nan), "m"),
    ]
