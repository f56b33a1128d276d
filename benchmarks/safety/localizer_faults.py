"""What the dense localiser says while something is wrong, and how often it complains while nothing is.

A camera with odometry drives up and down halls that have been mapped; again and again something fails for two seconds.
Undetected is a failure during which a pose more than 0.3 m or 3 degrees wrong is told as TRACKING. The delay is the
time of the fault until the first answer that is not TRACKING. Starts from nowhere have one second of images.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from dataclasses import dataclass, field
from unittest.mock import patch

import numpy as np

from benchmarks.report import Bound, Headline, Report, Table
from benchmarks.safety.halls import CAMERA, FAULTS, KIDNAPPED, Fault, Lamp, World, elsewhere, kidnapped, nothing
from dense_localizer.localizer import Localizer
from dense_localizer.params import LocalizerParams
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import State
from sphere_nav.params import build
from sphere_nav.photometric.align import esm

SETTINGS = {"acceptance.min_pixels": 200, "alignment.num_levels": 4}  # for images so small
SIZES = {"quick": (1, 12, 0.03, 4, 4), "full": (6, 504, 5.0, 200, 50)}  # halls, failures, km, starts, outside
SOUGHT = State.NOT_LOCALISED, State.SEARCHING
SECOND = 1_000_000_000
RATE = 15  # Hz
SPEED, NOMINAL_SPEED = 1.0, 5.0  # m/s, while things fail and while nothing does
FAULT_IMAGES, CALM_IMAGES = 2 * RATE, RATE
WRONG_M, WRONG_RAD = 0.3, np.radians(3.0)
LONG_S = 1.0  # a shorter DEGRADED is no false alarm
WRONG_START_M, WRONG_START_RAD = 1.5, np.radians(30.0)  # an initial pose is off by as much at most, each axis


@dataclass
class Found:
    """What was counted; of failures by their kinds."""

    injected: dict[str, int] = field(default_factory=lambda: defaultdict(int))
    undetected: dict[str, int] = field(default_factory=lambda: defaultdict(int))
    delays_s: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    worst_m: dict[str, float] = field(default_factory=lambda: defaultdict(float))  # in TRACKING
    false_alarms: int = 0
    num_nominal: int = 0
    num_trusted: int = 0
    distance_m: float = 0.0
    nees: list[float] = field(default_factory=list)
    starts: list[bool] = field(default_factory=list)  # from nowhere, whether tracked within a second
    num_wrong: int = 0  # of them
    outside: list[bool] = field(default_factory=list)  # of the map, whether tracked
    alignments: dict[bool, list[int]] = field(default_factory=lambda: {False: [], True: []})  # an image; of a search


@dataclass(frozen=True)
class Told:
    """What the localiser said to an image, and how wrong it was: NaN without a pose."""

    state: State
    meters: float = np.nan
    radians: float = np.nan
    nees: float = np.nan

    @property
    def is_trusted(self) -> bool:
        """Whether the pose was told without reserve."""
        return self.state is State.TRACKING

    @property
    def is_undetected(self) -> bool:
        """Whether it was wrong, too."""
        return self.is_trusted and bool(self.meters > WRONG_M or self.radians > WRONG_RAD)


class Run:
    """One camera that drives and drives in one hall."""

    def __init__(self, world: World, found: Found) -> None:
        self.world, self.found, self._stamp_ns = world, found, SECOND
        self.localizer, self._is_sought = Localizer(build(LocalizerParams, SETTINGS), world.map), True

    def step(self, fault: Fault = nothing, speed: float = SPEED) -> Told:
        """Localise the next image."""
        world = self.world
        self._stamp_ns += SECOND // RATE
        moved = world.drive(1.0 / RATE, speed)
        self.found.distance_m += moved * (speed == NOMINAL_SPEED)
        image = fault(world)
        with patch.object(esm, "share_pixels", wraps=esm.share_pixels) as asked:  # by each dense alignment, once
            told = self.localizer.update(image, CAMERA, self._stamp_ns, world.T_odom_camera)
        self.found.alignments[self._is_sought].append(asked.call_count)
        self._is_sought = told.status.state in SOUGHT
        if told.T_map_camera is None or told.covariance is None:
            return Told(told.status.state)
        truth = world.T_map_camera @ KIDNAPPED if fault is kidnapped else world.T_map_camera
        xi = (told.T_map_camera.inverse() @ truth).log()
        nees = float(xi @ np.linalg.solve(told.covariance, xi))
        meters, radians = told.T_map_camera.distance(truth)
        return Told(told.status.state, float(meters), float(radians), nees)

    def _reset(self) -> None:
        self.localizer.reset()
        self._is_sought = True

    def settle(self) -> None:
        """Drive on until the pose is trusted again."""
        if self.step().is_trusted:
            return
        self._reset()
        self.localizer.relocalize(self.world.T_map_camera)
        for _ in range(CALM_IMAGES):
            if self.step().is_trusted:
                return

    def drive(self, meters: float) -> None:
        """Drive with nothing wrong."""
        bad, end = 0, self.found.distance_m + meters
        while self.found.distance_m < end:
            told = self.step(speed=NOMINAL_SPEED)
            self.found.num_nominal += 1
            self.found.num_trusted += told.is_trusted
            self.found.undetected["nothing"] += told.is_undetected
            bad = 0 if told.is_trusted else bad + 1
            self.found.false_alarms += bad == round(LONG_S * RATE)
            if np.isfinite(told.nees):
                self.found.nees.append(told.nees)

    def inject(self, name: str) -> None:
        """Let something fail."""
        found, told_after, wrong = self.found, np.nan, False
        self.world.lamp = Lamp.random(self.world.rng)
        found.injected[name] += 1
        if name == "wrong start":
            off = self.world.rng.uniform(-1.0, 1.0, 6) * np.repeat([WRONG_START_M, WRONG_START_RAD], 3)
            self.localizer.relocalize(self.world.T_map_camera @ SE3.exp(off))
        for k in range(FAULT_IMAGES):
            told = self.step(FAULTS[name])
            wrong |= told.is_undetected
            if told.is_trusted:
                found.worst_m[name] = max(found.worst_m[name], told.meters)
            elif np.isnan(told_after):
                told_after = k / RATE
        found.undetected[name] += wrong
        if np.isfinite(told_after):
            found.delays_s[name].append(told_after)

    def start(self, fault: Fault = nothing) -> tuple[bool, bool]:
        """Start anywhere with a second of images; return whether it came to a trusted pose, and whether to a wrong."""
        self.world.jump()
        self._reset()
        told = [self.step(fault) for _ in range(RATE)]
        return any(one.is_trusted for one in told), any(one.is_undetected for one in told)


def run(options: argparse.Namespace) -> Report:
    """Drive, let things fail and start, in one hall after the other."""
    halls, injections, km, starts, outside = SIZES[options.size]
    found, names = Found(), list(FAULTS)
    for hall in range(halls):
        drive = Run(World(options.seed + 100 * hall, hall % 2 == 1), found)
        for k in range(hall, injections, halls):
            drive.settle()
            drive.inject(names[k // halls % len(names)])
        drive.settle()
        drive.drive(1000.0 * km / halls)
        for _ in range(hall, starts, halls):
            is_found, is_wrong = drive.start()
            found.starts.append(is_found)
            found.num_wrong += is_wrong
        found.outside += [drive.start(elsewhere)[0] for _ in range(hall, outside, halls)]
        drive.localizer.references.close()
    report, rows = Report("localizer_faults", notes=[__doc__ or ""], bounds=_bounds(found)), list[tuple[str, ...]]()
    for name, count in found.injected.items():
        delays = found.delays_s[name]
        told = f"{np.median(delays):.2f}, {np.max(delays):.2f}" if delays else "-"
        counts = str(count), str(found.undetected[name]), str(len(delays))
        rows.append((name, *counts, told, f"{found.worst_m[name]:.3f}"))
    columns = ("what fails for 2 s", "times", "undetected", "told", "delay s, median, max", "worst in TRACKING, m")
    report.tables.append(Table("Failures", columns, rows))
    return report


def _bounds(found: Found) -> list[Bound]:
    total, km = sum(found.injected.values()), found.distance_m / 1000
    wrong, told = sum(found.undetected[name] for name in found.injected), Headline("robustness", "halls")
    mean, untroubled = float(np.mean(found.nees)), f"in {km:.2f} km without a failure"
    started, placed = 100.0 * float(np.mean(found.starts)), sum(found.outside)
    tracking = found.num_trusted / max(found.num_nominal, 1)
    return [
        Bound(f"undetected of {total} failures", 0.0, wrong, "", headline=told),
        Bound(f"wrong and TRACKING {untroubled}", 0.0, found.undetected["nothing"], "images", headline=told),
        Bound(f"false DEGRADED longer than 1 s {untroubled}", 0.2, found.false_alarms / km, "per km"),
        Bound("TRACKING without a failure", 0.99, tracking, "", is_minimum=True),
        Bound("mean NEES, 6 when honest", 12.0, mean, ""),
        Bound("mean NEES, 6 when honest, at least", 3.0, mean, "", is_minimum=True),
        Bound(f"{len(found.starts)} starts from nowhere, TRACKING in 1 s", 95.0, started, "%", is_minimum=True),
        Bound("dense alignments of an image that is followed, most", 3, max(found.alignments[False]), ""),
        Bound("the same, 99 of 100 images", 3, float(np.percentile(found.alignments[False], 99)), ""),
        Bound("dense alignments of a search, most", 6, max(found.alignments[True]), ""),
        Bound("starts from nowhere that come to a wrong pose", 0.0, found.num_wrong, ""),
        Bound(f"{len(found.outside)} starts outside the map that come to a pose", 0.0, placed, ""),
    ]
