"""A taught way of the simulator, repeated by day and night, in four seasons, among other cars.

A rig is driven along the way once, its images are stitched and mapped. Then a camera drives there N times, in an order
of lights and seasons drawn by a seed, each time with other cars parked, other traffic, clouds and noise. Each drive is
localised from nowhere in the newest map. One that was not tracked well is driven again by the rig, and extends the map,
as `sphere_nav map --extend` does it. All by the commands and the simulator's own driver.

An error is that of the vehicle relative to the taught drive: what the map says of both against the truth of both.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.commands import call, read_states
from benchmarks.drive.missions import Taught, record_drive
from benchmarks.report import Bound, Headline, Report, Table
from cycab_sim.params import SimParams
from cycab_sim.simulator import Simulator
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.files.rig_file import rig_text
from sphere_nav.geometry.trajectory import Trajectory, read_tum
from sphere_nav.params import build
from sphere_nav.ros.bags import BagReader
from sphere_nav.ros.conversions import stamp_ns
from sphere_nav.ros.maps.reader import FILE_NAME, open_map
from sphere_nav_tools.cli.demo.demo import OTHER_DAY, SIMULATION, read_truth

KINDS = ("", "overcast", "autumn", "winter", "snow", "wet", "low_sun", "dusk", "night_lamps")  # "": the taught day
STRAIGHT_M = 30.0  # of the shorter path of the simulator; the other has two turns
WELL_TRACKED = 0.99  # share of a drive's images; what is below it is driven by the rig and extends the map
MAX_CLOUDS = 0.7  # share of the sun that passing clouds take, at most
MOVING_M_S = 0.05  # slower is standing: a drive begins when the vehicle does
WRONG_M = 0.3  # off the truth
SIZES = {"quick": (2, 4.0, ("", "low_sun")), "full": (30, 100.0, KINDS)}  # drives, metres, kinds
MAX_SIZE, MAX_RMSE_M = 2.0, 0.03  # of the last map by the first one
COLUMNS = ("drive", "kind", "visit", "images", "TRACKING", "start", "wrong", "lateral RMSE", "map", "then")


def run(options: argparse.Namespace) -> Report:
    """Teach, repeat, and judge."""
    count, length_m, kinds = SIZES[options.size]
    drives = draw_drives(count, options.seed, kinds)
    repeats = Repeats(Way(options.seed, length_m), options.folder)
    for drive in drives:
        repeats.repeat(drive)
        print(" | ".join(repeats.rows[-1]), file=sys.stderr, flush=True)
    sizes = [(one / FILE_NAME).stat().st_size for one in (repeats.maps[0], repeats.maps[-1])]
    title = f"{count} repeats of {length_m:g} m"
    report = Report("repeats", [Table(title, COLUMNS, repeats.rows)], notes=[__doc__ or "", *repeats.notes])
    report.bounds += judge(repeats.found, sizes[1] / sizes[0], f"{title} in {len({d.kind for d in drives})} lights")
    return report


def judge(found: list[tuple[Drive, Found]], size: float, data: str) -> list[Bound]:
    """Return the bounds: of visits from the second of a kind on, of all where there is none; `size` of the map."""
    known = [one for drive, one in found if drive.visit > 1] or [one for _, one in found]
    share = sum(one.share * one.num_images for one in known) / sum(one.num_images for one in known)
    errors = [one.lateral_rmse_m for one in known if np.isfinite(one.lateral_rmse_m)]
    of, num_wrong = Headline("other light", data), sum(one.num_wrong for _, one in found)
    return [
        Bound("repeats: TRACKING from the second visit of a kind on", 0.99, share, "", True, of),
        Bound("repeats: the same, worst drive", 0.99, min(one.share for one in known), "", True, of),
        Bound("repeats: wrong in TRACKING, all drives", 0, num_wrong, ""),
        Bound("repeats: map over that of the first day", MAX_SIZE, size, ""),
        Bound("repeats: lateral RMSE, worst drive", MAX_RMSE_M, max(errors, default=np.nan), "m"),
    ]


@dataclass(frozen=True)
class Way:
    """What is driven: the town, and how far along the shortest path that is long enough."""

    seed: int
    length_m: float

    def record(self, bag: Path, more: dict[str, Any], *, by_rig: bool) -> None:
        """Drive along the way by the simulator's driver; write what its node would publish."""
        path = "straight" if self.length_m <= STRAIGHT_M else "two_turns"
        seen = {"camera.period": 0.0} if by_rig else {"rig.kind": "none"}
        values = SIMULATION | {"seed": self.seed, "mode": "teach", "path": path} | more | seen
        simulator = Simulator(build(SimParams, values))
        record_drive(simulator, bag, self.length_m)
        if simulator.rig is not None:
            (bag / "rig.yaml").write_text(rig_text(simulator.rig), encoding="utf-8")

    def teach(self, folder: Path) -> Taught:
        """Drive and map the first day in a folder."""
        bag, path = folder / "teach", folder / "taught.tum"
        self.record(bag, {}, by_rig=True)
        call("map", bag, "-o", folder / "map", "--taught", path, "--rig", bag / "rig.yaml")
        return Taught(read_tum(path), read_truth(bag))


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
    drives = []
    for number, kind in enumerate(order):
        clouds = round(float(np.random.default_rng([seed, number]).uniform(0.0, MAX_CLOUDS)), 2)
        drives.append(Drive(number + 1, kind, order[: number + 1].count(kind), clouds))
    return drives


@dataclass(frozen=True)
class Found:
    """How a drive was localised: images of the moving vehicle, share in TRACKING, the rest of them by reason and state.

    start_s: from the first image to the first pose in TRACKING, s (NaN: none); of the poses in TRACKING `off` (N, 6) m
    and rad, in the vehicle's axes, and `sigmas` (N,), how far off that is by their covariances.
    """

    num_images: int
    share: float
    start_s: float
    why: str
    off: Array
    sigmas: Array

    @property
    def num_wrong(self) -> int:
        """How many poses are wrong."""
        return int(np.sum(np.linalg.norm(self.off[:, :3], axis=1) > WRONG_M))

    @property
    def lateral_rmse_m(self) -> float:
        """Of the poses; NaN: none."""
        return float(np.sqrt(np.mean(self.off[:, 1] ** 2))) if len(self.off) else float("nan")

    def cells(self) -> tuple[str, ...]:
        """Return them as they are printed."""
        start = "-" if np.isnan(self.start_s) else f"{self.start_s:.1f} s"
        error = "-" if np.isnan(self.lateral_rmse_m) else f"{1e3 * self.lateral_rmse_m:.1f} mm"
        return f"{self.num_images}", f"{self.share:.1%}", start, f"{self.num_wrong}", error


def localise(map_folder: Path, bag: Path, folder: Path, taught: Taught, *words: object) -> Found:
    """Localise a drive by its camera, from nowhere where no words say more."""
    folder.mkdir()
    problem = ""
    try:
        call("localize", map_folder, bag, "-o", folder / "poses.tum", "--bag", folder / "said", *words)
    except ValueError as error:
        problem = str(error)
    truth = read_truth(bag)
    with BagReader(bag) as reader:
        images = np.array([stamp_ns(item.message) for item in reader.messages(["/image_raw"])])
    states = read_states(folder / "said") if (folder / "said").is_dir() else {}
    speeds = np.linalg.norm(np.diff(truth.positions, axis=0), axis=1) / (np.diff(truth.stamps_ns) * 1e-9)
    moving = images[images >= truth.stamps_ns[int(np.argmax(speeds > MOVING_M_S))]]
    told = {stamp: states.get(stamp, ("no answer", "")) for stamp in images.tolist()}
    tracked = np.array([stamp for stamp, (state, _) in told.items() if state == "TRACKING"], dtype=np.int64)
    counts = Counter(" ".join(told[stamp]).strip() for stamp in moving.tolist() if told[stamp][0] != "TRACKING")
    why = ", ".join(f"{number} {what}" for what, number in counts.items()) or problem
    if not len(tracked):
        return Found(len(moving), 0.0, float("nan"), why, np.empty((0, 6)), np.empty(0))
    poses = read_tum(folder / "poses.tum")
    start_s, share = float(tracked[0] - images[0]) / 1e9, float(np.isin(moving, tracked).mean())
    return Found(len(moving), share, start_s, why, *deviations(poses[np.isin(poses.stamps_ns, tracked)], truth, taught))


def deviations(estimate: Trajectory, truth: Trajectory, taught: Taught) -> tuple[Array, Array]:
    """Return by how much (N, 6) m and rad poses in the map are off, by the nearest taught pose; in deviations (N,)."""
    at, known = truth.at(estimate.stamps_ns, max_gap_ns=200_000_000)
    poses = estimate[known]
    off = [(at.T_map_body[k].inverse() @ taught.to_world(poses.T_map_body[k])).log() for k in range(len(poses))]
    rows = np.array(off).reshape(-1, 6)
    assert poses.covariances is not None
    return rows, np.sqrt(np.einsum("ni,nij,nj->n", rows, np.linalg.inv(poses.covariances), rows))


class Repeats:
    """The drives of one way, and the maps that they made."""

    def __init__(self, way: Way, folder: Path) -> None:
        self.way, self.folder, self.taught = way, folder, way.teach(folder)
        self.maps = [folder / "map"]
        self.notes: list[str] = []
        self.rows: list[tuple[str, ...]] = []
        self.found: list[tuple[Drive, Found]] = []

    def repeat(self, drive: Drive) -> None:
        """Drive once more, localise, extend the map where that was not well."""
        bag, known = self.folder / drive.name, self.maps[-1]
        self.way.record(bag, drive.parameters, by_rig=False)
        found = localise(known, bag, self.folder / f"{drive.name}_found", self.taught)
        then = "tracked" if found.share >= WELL_TRACKED else self._extend(drive, known)
        self.found.append((drive, found))
        size = f"{(self.maps[-1] / FILE_NAME).stat().st_size / 1e6:.1f} MB"
        self.rows.append((f"{drive.number}", drive.kind or "day", f"{drive.visit}", *found.cells(), size, then))
        if found.why:
            self.notes.append(f"{drive.name}: {found.why}")

    def _extend(self, drive: Drive, known: Path) -> str:
        """Drive the same by the rig and join that to the map, which begins where the drive does."""
        bag, made = self.folder / f"{drive.name}_rig", self.folder / f"map_{drive.name}"
        self.way.record(bag, drive.parameters, by_rig=True)
        start, name = ("--start", 0.0, 0.0, 0.0), ("--experience", drive.kind or "day")
        try:
            call("map", bag, "-o", made, "--extend", known, *start, *name, "--rig", bag / "rig.yaml")
        except ValueError as error:
            self.notes.append(f"{drive.name}: {error}")
            if not made.is_dir():  # else some of its spheres were not placed, and the others are in the map
                return "refused"
        self.maps.append(made)
        with open_map(made) as reader:
            return f"extended to {len(reader.graph)}"
