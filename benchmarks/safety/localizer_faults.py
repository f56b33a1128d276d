"""What the dense localiser says while something is wrong, and how often it complains while nothing is.

A camera with odometry drives up and down halls that have been mapped; again and again something fails for two seconds.
Undetected is a failure during which a pose more than 0.3 m or 3 degrees wrong is told as TRACKING. The delay is the
time of the fault until the first answer that is not TRACKING. Starts from nowhere have one second of images.
"""

from __future__ import annotations

import argparse
import sys
from collections import defaultdict
from dataclasses import dataclass, field
from itertools import chain, groupby
from operator import attrgetter
from pathlib import Path
from types import FrameType
from unittest.mock import patch

import numpy as np

import dense_localizer
import sphere_nav
from benchmarks.report import Bound, Headline, Report, Table
from benchmarks.safety.halls import CAMERA, FAULTS, KIDNAPPED, Fault, World, draw_lamp, elsewhere, kidnapped, nothing
from dense_localizer.localizer import Localizer
from dense_localizer.params import LocalizerParams
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import State
from sphere_nav.params import build
from sphere_nav.photometric.align import esm

SETTINGS = {"acceptance.min_pixels": 200, "alignment.num_levels": 4}  # for images so small
SIZES = {"quick": (1, 12, 0.03, 4, 4), "full": (6, 504, 5.0, 200, 50)}  # halls, failures, km, starts, outside
SECOND = 1_000_000_000
RATE = 15  # Hz
SPEED, NOMINAL_SPEED = 1.0, 5.0  # m/s, while things fail and while nothing does
FAULT_IMAGES, CALM_IMAGES = 2 * RATE, RATE
WRONG_M, WRONG_RAD = 0.3, np.radians(3.0)
IS_TRUSTED = attrgetter("is_trusted")
PRODUCT = tuple(Path(str(package.__file__)).parent for package in (dense_localizer, sphere_nav))
LONG_S = 1.0  # a shorter DEGRADED is no false alarm
WRONG_START_M, WRONG_START_RAD = 1.5, np.radians(30.0)  # an initial pose is off by as much at most, each axis


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


@dataclass
class Found:
    """What was said image by image: in each failure, by its kind, while nothing failed, and to starts from nowhere."""

    failures: dict[str, list[list[Told]]] = field(default_factory=lambda: defaultdict(list))
    nominal: list[list[Told]] = field(default_factory=list)
    starts: list[list[Told]] = field(default_factory=list)
    outside: list[list[Told]] = field(default_factory=list)  # of the map
    distance_m: float = 0.0  # with nothing wrong
    alignments: dict[bool, list[int]] = field(default_factory=lambda: {False: [], True: []})  # an image; of a search
    num_files: list[int] = field(default_factory=list)  # that images in TRACKING pass, with nothing wrong


class Run:
    """One camera that drives and drives in one hall."""

    def __init__(self, world: World, found: Found) -> None:
        self.world, self.found, self._stamp_ns = world, found, SECOND
        self.localizer = Localizer(build(LocalizerParams, SETTINGS), world.map)

    def step(self, fault: Fault = nothing, speed: float = SPEED) -> Told:
        """Localise the next image."""
        world = self.world
        self._stamp_ns += SECOND // RATE
        moved = world.drive(1.0 / RATE, speed)
        self.found.distance_m += moved * (speed == NOMINAL_SPEED)
        image, passed = fault(world), set[str]()

        def note(frame: FrameType, *_: object) -> None:
            passed.add(frame.f_code.co_filename)

        search = self.localizer.search
        with (
            patch.object(esm, "share_pixels", wraps=esm.share_pixels) as asked,  # by each dense alignment, once
            patch.object(search, "find", wraps=search.find) as sought,
        ):
            sys.setprofile(note)
            told = self.localizer.update(image, CAMERA, self._stamp_ns, world.T_odom_camera)
            sys.setprofile(None)
        if speed == NOMINAL_SPEED and told.status.state is State.TRACKING:
            self.found.num_files.append(sum(any(map(Path(one).is_relative_to, PRODUCT)) for one in passed))
        self.found.alignments[sought.called].append(asked.call_count)
        if told.T_map_camera is None or told.covariance is None:
            return Told(told.status.state)
        truth = world.T_map_camera @ KIDNAPPED if fault is kidnapped else world.T_map_camera
        xi = (told.T_map_camera.inverse() @ truth).log()
        nees = float(xi @ np.linalg.solve(told.covariance, xi))
        meters, radians = told.T_map_camera.distance(truth)
        return Told(told.status.state, float(meters), float(radians), nees)

    def settle(self) -> None:
        """Drive on until the pose is trusted again."""
        if self.step().is_trusted:
            return
        self.localizer.reset()
        self.localizer.relocalize(self.world.T_map_camera)
        for _ in range(CALM_IMAGES):
            if self.step().is_trusted:
                return

    def drive(self, meters: float) -> None:
        """Drive with nothing wrong."""
        end = self.found.distance_m + meters
        self.found.nominal.append([])
        while self.found.distance_m < end:
            self.found.nominal[-1].append(self.step(speed=NOMINAL_SPEED))

    def inject(self, name: str) -> None:
        """Let something fail."""
        self.world.lamp = draw_lamp(self.world.rng)
        if name == "wrong start":
            off = self.world.rng.uniform(-1.0, 1.0, 6) * np.repeat([WRONG_START_M, WRONG_START_RAD], 3)
            self.localizer.relocalize(self.world.T_map_camera @ SE3.exp(off))
        self.found.failures[name].append([self.step(FAULTS[name]) for _ in range(FAULT_IMAGES)])

    def start(self, fault: Fault = nothing) -> list[Told]:
        """Start anywhere with a second of images."""
        self.world.jump()
        self.localizer.reset()
        return [self.step(fault) for _ in range(RATE)]


def run(options: argparse.Namespace) -> Report:
    """Drive, let things fail and start, in one hall after the other."""
    halls, injections, km, starts, outside = SIZES[options.size]
    found, names = Found(), list(FAULTS)
    for hall in range(halls):
        drive = Run(World(options.seed + 100 * hall, is_soft=hall % 2 == 1), found)
        for k in range(hall, injections, halls):
            drive.settle()
            drive.inject(names[k // halls % len(names)])
        drive.settle()
        drive.drive(1000.0 * km / halls)
        found.starts += [drive.start() for _ in range(hall, starts, halls)]
        found.outside += [drive.start(elsewhere) for _ in range(hall, outside, halls)]
        drive.localizer.references.close()
    report, rows = Report("localizer_faults", notes=[__doc__ or ""], bounds=_bounds(found)), list[tuple[str, ...]]()
    for name, times in found.failures.items():
        firsts = [[k for k, one in enumerate(told) if not one.is_trusted][:1] for told in times]
        delays = [first / RATE for several in firsts for first in several]
        told = f"{np.median(delays):.2f}, {np.max(delays):.2f}" if delays else "-"
        worst = max((one.meters for told in times for one in told if one.is_trusted), default=0.0)
        counts = str(len(times)), str(_count_wrong(times)), str(len(delays))
        rows.append((name, *counts, told, f"{worst:.3f}"))
    columns = ("what fails for 2 s", "times", "undetected", "told", "delay s, median, max", "worst in TRACKING, m")
    report.tables.append(Table("Failures", columns, rows))
    return report


def _count_wrong(times: list[list[Told]]) -> int:
    return sum(any(one.is_undetected for one in told) for told in times)


def _bounds(found: Found) -> list[Bound]:
    failures, nominal = list(chain(*found.failures.values())), list(chain(*found.nominal))
    km, told = found.distance_m / 1000, Headline("robustness", "halls")
    runs = [(is_trusted, len(list(run))) for one in found.nominal for is_trusted, run in groupby(one, IS_TRUSTED)]
    num_alarms = sum(not is_trusted and length >= LONG_S * RATE for is_trusted, length in runs)
    started, placed = ([any(map(IS_TRUSTED, told)) for told in times] for times in (found.starts, found.outside))
    mean, untroubled = float(np.nanmean([one.nees for one in nominal])), f"in {km:.2f} km without a failure"
    num_wrong, followed = sum(one.is_undetected for one in nominal), found.alignments[False]
    tracking = float(np.mean(list(map(IS_TRUSTED, nominal))))
    return [
        Bound(f"undetected of {len(failures)} failures", 0.0, _count_wrong(failures), "", headline=told),
        Bound(f"wrong and TRACKING {untroubled}", 0.0, num_wrong, "images", headline=told),
        Bound(f"false DEGRADED longer than 1 s {untroubled}", 0.2, num_alarms / km, "per km"),
        Bound("TRACKING without a failure", 0.99, tracking, "", is_minimum=True),
        Bound("mean NEES, 6 when honest", 12.0, mean, ""),
        Bound("mean NEES, 6 when honest, at least", 3.0, mean, "", is_minimum=True),
        Bound(f"{len(started)} starts from nowhere, TRACKING in 1 s", 95.0, 100.0 * float(np.mean(started)), "%", True),
        Bound("dense alignments of an image that is followed, most", 3, max(followed), ""),
        Bound("the same, 99 of 100 images", 3, float(np.percentile(followed, 99)), ""),
        Bound("dense alignments of a search, most", 6, max(found.alignments[True]), ""),
        Bound("files of the product that an image in TRACKING passes, most", 12, max(found.num_files), ""),
        Bound("starts from nowhere that come to a wrong pose", 0.0, _count_wrong(found.starts), ""),
        Bound(f"{len(placed)} starts outside the map that come to a pose", 0.0, sum(placed), ""),
    ]
