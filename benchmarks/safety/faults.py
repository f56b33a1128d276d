"""What happens in each fault of a drive, and how fast: images, localiser and follower in lock-step.

A simulated street at 10 images a second, which `dense_localizer` and `path_follower` answer in one process by
simulated, stamped time: the machine's speed does not matter. Faults begin at a random instant between two images, at
1.4 m/s. The time to zero command counts from there; the ramp takes 0.35 s of it. Where a fault takes the pose sooner or
later or not at all, the bound counts from the last image that the map has placed rightly.
"""

from __future__ import annotations

import argparse
import logging
import math
from dataclasses import dataclass, field

import numpy as np
from tqdm import tqdm

from benchmarks.fault_drives import SECOND, Course, Drive, Gauge
from benchmarks.fault_list import FAULTS, Fault
from benchmarks.report import Bound, Headline, Report, Table

FULL, QUICK = (5, 75), (1, 1)  # drives of each fault, laps of 23 m by images
LIMIT = 0.85  # s from the loss of the pose to zero command
ASIDE = 0.3  # m from the path: more is a wrong motion
STILL = 0.3  # s of zero command after which a stop is a stop
COLUMNS = ("fault", "what", "reason", "zero after min [s]", "median", "max", "way [m]", "aside [m]", "drives again")


@dataclass
class Outcome:
    """Times to zero in s (infinite: it drove on), from the fault and from the loss of the pose; what else was seen."""

    fault: Fault
    to_zero: list[float] = field(default_factory=list)
    since_loss: list[float] = field(default_factory=list)
    reasons: set[str] = field(default_factory=set)
    recoveries: set[str] = field(default_factory=set)
    way: float = 0.0
    aside: float = 0.0

    def suffer(self, course: Course, seed: int) -> None:
        """Drive, let the fault begin, end it, and see whether the vehicle goes on."""
        drive = Drive(course, seed, has_odometry=self.fault.has_odometry)
        _drive_off(drive)
        began, fault, follower = drive.now, self.fault, drive.follower.loop.follower
        drive.gauge = Gauge([])
        drive.images = lambda messages: fault.images(drive, messages, (drive.now - began) / SECOND)
        fault.begin(drive)
        for _ in range(round(fault.seconds / 0.1)):
            drive.run(0.1)
            if _zero_since(drive, began) <= drive.now - round(STILL * SECOND):
                break
        zero = _zero_since(drive, began)
        self.to_zero.append((zero - began) / SECOND)
        placed = [at for at in drive.gauge.placed if at < zero] if fault.stops is None else []
        lost = max([began, *placed])
        self.since_loss.append((zero - lost) / SECOND)
        self.reasons.add(str(follower.mode.verdict.reason) if math.isfinite(zero) else "drives on")
        self.way, self.aside = max(self.way, drive.gauge.way), max(self.aside, drive.gauge.aside)
        drive.images = None
        fault.end(drive)
        drive.run(1.0)
        answer = "by itself" if follower.mode.is_driving else f"`start`: {drive.start() or 'drives again'}"
        self.recoveries.add(answer)
        drive.bus.close()

    @property
    def row(self) -> tuple[str, ...]:
        """Return the cells of the table."""
        times = [t for t in self.to_zero if math.isfinite(t)]
        cells = [f"{f(times):.2f}" for f in (min, np.median, max)] if times else ["–"] * 3
        reasons, ends = ", ".join(sorted(self.reasons)), "; ".join(sorted(self.recoveries))
        aside = "–" if self.fault.is_moved else f"{self.aside:.2f}"
        return (self.fault.number, self.fault.name, reasons, *cells, f"{self.way:.2f}", aside, ends)


def _drive_off(drive: Drive) -> None:
    """Localise, start, and drive at full speed up to a random instant between two images."""
    for _ in range(50):
        drive.run(0.1)
        if not drive.start():
            break
    else:
        raise RuntimeError(f"start: {drive.start()}")
    while drive.command.speed < 1.39:
        drive.run(0.1)
    drive.run(0.3 + float(drive.rng.integers(0, 10)) / 100)


def _zero_since(drive: Drive, began: int) -> float:
    """Return since when the command is zero, in ns; infinite while it is not."""
    last = [at for at, speed in drive.gauge.commands if speed != 0.0]
    zeros = [at for at, speed in drive.gauge.commands if speed == 0.0 and at > max(last, default=0)]
    return zeros[0] if zeros else math.inf


def run(options: argparse.Namespace) -> Report:
    """Suffer every fault; drive without any."""
    logging.getLogger("sphere_nav").setLevel(logging.CRITICAL)
    runs, num_laps = QUICK if options.size == "quick" else FULL
    course = Course(options.folder)
    outcomes = [Outcome(fault) for fault in FAULTS]
    for outcome in tqdm(outcomes, unit="fault", disable=None):
        for seed in range(runs):
            outcome.suffer(course, 1000 + seed)
    bounds = [*_bounds(outcomes), _laps(course, num_laps)]
    return Report("faults", [Table("Faults", COLUMNS, [o.row for o in outcomes])], bounds)


def _bounds(outcomes: list[Outcome]) -> list[Bound]:
    fast = [o for o in outcomes if o.fault.seconds == Fault.seconds]
    times = [t for o in fast for t in o.since_loss if o.fault.stops or (o.fault.stops is None and math.isfinite(t))]
    drove_on = sum(math.isfinite(t) for o in outcomes if o.fault.stops is False for t in o.to_zero)
    aside = max((o.aside for o in fast if not o.fault.is_moved), default=0.0)
    of = Headline("time to zero", f"{len(fast)} faults, images and nodes in lock-step")
    return [
        Bound(
            "loss of the pose to zero command, largest of all faults", LIMIT, max(times, default=0.0), "s", headline=of
        ),
        Bound("stops in faults that should be driven through", 0, drove_on, ""),
        Bound("largest distance from the path in a fault", ASIDE, aside, "m"),
    ]


def _laps(course: Course, count: int) -> Bound:
    """Drive to the end of the course with a tenth of the images lost."""
    num_stops, way, seconds = 0, 0.0, 0.0
    for seed in tqdm(range(count), unit="lap", disable=None):
        drive = Drive(course, 2000 + seed)
        _drive_off(drive)
        lost = np.random.default_rng(seed)
        drive.images = lambda messages, lost=lost: messages if lost.random() >= 0.1 else []
        drive.gauge, began = Gauge([]), drive.now
        while drive.place[0] < course.length - 4.0 and drive.now - began < 60 * SECOND:
            drive.run(0.5)
            drive.start()
        num_stops, way = num_stops + drive.gauge.num_stops, way + drive.gauge.way
        seconds += (drive.now - began) / SECOND
        drive.bus.close()
    what = f"false stops in {way:.0f} m ({seconds / 3600:.2f} h) by images, 10 % of them lost"
    return Bound(what, 1, num_stops, "")
