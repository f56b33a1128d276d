"""What happens in each fault of a drive, and how fast: images, localiser and follower in lock-step; docs/faults.md.

A simulated street at 10 images a second, which `dense_localizer` and `path_follower` answer in one process by
simulated, stamped time: the machine's speed does not matter. Faults begin at a random instant between two images, at
1.4 m/s. The time to zero command counts from there; the ramp takes 0.35 s of it. Signals go to real processes over
real DDS.
"""

from __future__ import annotations

import argparse
import logging
import math
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from tqdm import tqdm

from benchmarks.fault_drives import SECOND, Course, Drive, Gauge
from benchmarks.fault_list import FAULTS, Fault
from benchmarks.fault_nominal import nominal
from benchmarks.fault_processes import signalled
from benchmarks.report import Bound, Headline, Report, Table
from benchmarks.safety.fault_busy import suffer

HELP = "stops: time to zero command for each fault, false stops of long drives; writes docs/faults.md"
FULL, QUICK = (5, 75, 2.0, 200), (1, 1, 0.02, 2)  # drives of each fault, laps of 23 m by images, hours, signals
LIMIT = 0.85  # s from the loss of the pose to zero command
ASIDE = 0.3  # m from the path: more is a wrong motion
STILL = 0.3  # s of zero command after which a stop is a stop
ENDED = ("SIGINT", "SIGTERM")
HELD = (  # by a test, where a drive could not show it
    ("F6", "a camera of the rig is missing: spheres go on without it", "test/nodes/test_sphere_stitcher.py",
     "test_six_cameras_over_dds"),
    ("F13", "one wrong byte in a map costs one sphere", "test/sphere_nav/ros/maps/test_check.py",
     "test_one_flipped_bit_costs_one_sphere_at_most"),
    ("F13", "a process killed while it saves", "test/sphere_nav/ros/maps/test_reader.py",
     "test_a_process_killed_while_it_saves_leaves_a_whole_map"),
    ("F14", "a bag cut at every record", "test/sphere_nav/ros/bags/test_mcap_file.py", "test_a_cut_at_every_record"),
    ("F15", "the follower killed, behind command_guard", "test/nodes/test_stops_over_dds.py",
     "test_a_follower_that_is_killed_leaves_the_base_at_zero"),
    ("F15", "the follower stopped, and going on later", "test/nodes/test_stops_over_dds.py",
     "test_a_follower_that_is_stopped_leaves_the_base_at_zero_and_does_not_go_on_by_itself"),
    ("F15", "two real publishers of the pose", "test/nodes/test_stops_over_dds.py",
     "test_a_second_publisher_of_the_pose_is_named_and_stops"),
    ("F17", "a publisher with other QoS is named", "test/sphere_nav/ros/test_live.py",
     "test_what_is_missing_is_explained"),
    ("F18", "the camera's transform is missing", "test/nodes/test_dense_localizer.py",
     "test_an_image_that_waits_too_long_is_answered_with_the_reason"),
    ("F20", "a replay that begins late has /tf_static", "test/sphere_nav/ros/bags/test_replay.py",
     "test_latched_topics_hold_from_before_the_start"),
    ("F21", "parameters while the node works", "test/sphere_nav/ros/test_live.py",
     "test_parameters_are_fixed_while_the_node_is_configured"),
    ("F15", "command_guard killed and started again passes nothing before a new zero",
     "test/path_follower/guard/test_guard.py",
     "test_a_guard_that_is_new_takes_no_heartbeat_that_was_sent_before_for_one"),
    ("F15", "an operator's page with the dead-man switch is closed, or hangs: pressed within 0.75 s, zero 0.35 s later",
     "test/sphere_nav_tools/cli/operate/test_page.py",
     "test_with_the_dead_mans_switch_a_lost_page_presses_the_emergency_stop_within_seven_tenths"),
    ("F22", "a path that crosses itself", "test/path_follower/test_path.py",
     "test_at_a_crossing_the_foot_stays_on_its_branch"),
    ("F22", "a cusp: it stands while the wheels turn", "test/path_follower/test_follower.py",
     "test_the_vehicle_stands_still_between_directions"),
    ("F25", "SROS2 enforced without keys: the node does not start", "test/sphere_nav/ros/test_run.py",
     "test_enforced_security_is_never_left_out_and_the_reason_is_one_line"),
)  # fmt: skip
NOTE = """\
F25 (foreign messages) is tested no further: the Fast DDS of the Python wheels is built without security
([SROS2](security.md#sros2-each-node-has-its-keys))."""
PAGE = """\
# Faults

**What only the base can catch:** a `command_guard` that is frozen (SIGSTOP) or killed commands nothing, and a base
without a time-out of its own keeps the last command. Everything below is caught by the software.

This page shows what the vehicle does when something fails during a drive: which reason it gives, how long it takes from
the fault to the zero command, and how it goes on.

## In short

<!-- stops: begin -->
{promises}
<!-- stops: end -->

Where a fault does no harm, the vehicle drives on.

How it was measured: a simulated vehicle drives along a street at 1.4 m/s with 10 images a second. `dense_localizer` and
`path_follower` answer in one process, in simulated time, so that the speed of the computer does not matter. Each fault
begins at a random instant between two images. Times to zero include the braking ramp of 0.35 s. Signals (SIGINT,
SIGTERM) go to real processes over real DDS.

| column | meaning |
| --- | --- |
| fault | its number in the list of faults that the software must survive |
| reason | the stop reason ([all of them](path_follower.md#when-it-stops)), or `drives on` |
| zero after | seconds from the fault to the zero command: least, median, largest of all drives |
| way, aside | most metres driven from then on until zero (or in 2 s; slow faults: 8 s), and largest off the path |
| drives again | by itself, or after the call `start` |

In the table *Real processes* the follower runs as on a vehicle, over DDS, with a base that keeps the last command.
*alone*: nothing else runs. *busy*: two processes send it requests, parameters, paths of up to a million poses,
transforms and scans of a megabyte, as fast as they can. *loaded*: four processes on each core compute. *deaf*: a
process that subscribes to the follower's topics hangs. *front killed*: of the two processes of the follower, the one
with parameters and services is killed. The table *Bounds* also holds the longest time between two commands.

Generated by `python -m benchmarks safety faults --fault-page docs/faults.md`.

"""
COLUMNS = ("fault", "what", "reason", "zero after min [s]", "median", "max", "way [m]", "aside [m]", "drives again")


@dataclass
class Outcome:
    """Times to zero in s (infinite: it drove on), and what else was seen."""

    fault: Fault
    to_zero: list[float] = field(default_factory=list)
    reasons: set[str] = field(default_factory=set)
    recoveries: set[str] = field(default_factory=set)
    way: float = 0.0
    aside: float = 0.0

    def suffer(self, course: Course, seed: int) -> None:
        """Drive, let the fault begin, end it, and see whether the vehicle goes on."""
        drive = Drive(course, seed, has_odometry=self.fault.has_odometry)
        try:
            _drive_off(drive)
            self._suffer(drive)
        finally:
            drive.close()

    def _suffer(self, drive: Drive) -> None:
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
        self.reasons.add(str(follower.mode.verdict.reason) if math.isfinite(zero) else "drives on")
        self.way, self.aside = max(self.way, drive.gauge.way), max(self.aside, drive.gauge.aside)
        drive.images = None
        fault.end(drive)
        drive.run(1.0)
        answer = "by itself" if follower.mode.is_driving else f"`start`: {drive.start() or 'drives again'}"
        self.recoveries.add(answer)

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


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--fault-page", type=Path, help="write the tables to this page (docs/faults.md)")


def run(options: argparse.Namespace) -> Report:
    """Suffer every fault, drive without any, drive for hours, end follower processes by signals."""
    logging.getLogger("sphere_nav").setLevel(logging.CRITICAL)
    runs, num_laps, hours, signals = QUICK if options.size == "quick" else FULL
    with tempfile.TemporaryDirectory() as folder:
        course = Course(Path(folder))
        outcomes = list(_outcomes(course, runs))
        laps = _laps(course, num_laps)
    bounds = [*_bounds(outcomes), *laps, *_hours(hours), *_signals(signals)]
    real, busy = suffer(runs, signals if options.size == "full" else 0)
    bounds += busy
    notes = [NOTE]
    held = [(number, what, f"`{file}`", f"`{name}`" if name else "") for number, what, file, name in HELD]
    tables = [
        Table("Faults", COLUMNS, [o.row for o in outcomes]),
        *real,
        Table("Held by tests", ("fault", "what", "file", "test"), held),
    ]
    report = Report("faults", tables, bounds, notes)
    if options.fault_page:
        options.fault_page.write_text(page(report), encoding="utf-8")
    return report


def _bounds(outcomes: list[Outcome]) -> list[Bound]:
    fast = [o for o in outcomes if o.fault.seconds == Fault.seconds]
    times = [t for o in fast for t in o.to_zero if o.fault.stops or (o.fault.stops is None and math.isfinite(t))]
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


def page(report: Report) -> str:
    """Return docs/faults.md."""
    return PAGE.format(promises="\n".join(_promises(report))) + report.markdown() + "\n"


def _promises(report: Report) -> Iterator[str]:
    """Yield what one may rely on as measured, a table; README and other pages repeat it."""
    drives, processes = report.tables[:2]
    times = {row[1]: float(row[5]) for row in drives.rows if row[5] != "–"}
    times |= {row[0]: max(map(float, row[2:])) for row in processes.rows if row[0] not in ENDED}

    def largest(words: str) -> str:
        return f"{max(bound.measured for bound in report.bounds if words in bound.what):.2f} s"

    yield "| what happens at 1.4 m/s | zero commanded within |"
    yield "| --- | --- |"
    yield f"| pose lost, late, doubted or wrong | {max(time for time in times.values() if time <= LIMIT):.2f} s |"
    for name, time in times.items():
        if time > LIMIT:
            yield f"| but: {name} | {time:.1f} s |"
    yield f"| emergency stop | {largest('emergency stop to zero')} |"
    yield f"| Ctrl-C or SIGTERM | {largest('slowest zero')} |"


def _outcomes(course: Course, runs: int) -> Iterator[Outcome]:
    for fault in tqdm(FAULTS, unit="fault", disable=None):
        outcome = Outcome(fault)
        for seed in range(runs):
            outcome.suffer(course, 1000 + seed)
        yield outcome


def _laps(course: Course, count: int) -> list[Bound]:
    """Drive to the end of the course with a tenth of the images lost."""
    num_stops, way, seconds = 0, 0.0, 0.0
    course.see_coarsely()
    for seed in tqdm(range(count), unit="lap", disable=None):
        drive = Drive(course, 2000 + seed)
        _drive_off(drive)
        lost = np.random.default_rng(seed)
        drive.images = lambda messages, lost=lost: messages if lost.random() >= 0.1 else []
        drive.gauge, began = Gauge([]), drive.now
        while drive.along < course.length - 4.0 and drive.now - began < 60 * SECOND:
            drive.run(0.5)
            drive.start()
        num_stops, way = num_stops + drive.gauge.num_stops, way + drive.gauge.way
        seconds += (drive.now - began) / SECOND
        drive.close()
    what = f"false stops in {way:.0f} m ({seconds / 3600:.2f} h) by images, 10 % of them lost"
    return [Bound(what, 1, num_stops, "")] if count else []


def _hours(hours: float) -> list[Bound]:
    if not hours:
        return []
    false_stops, growth, files = nominal(hours)
    return [
        Bound(f"false stops in {hours:g} h at 10 Hz, 10 % of the poses lost, localiser simulated", 1, false_stops, ""),
        Bound("growth of memory over that drive", 5.0, growth, "MB/h"),
        Bound("growth of open files over that drive", 0, files, ""),
    ]


def _signals(count: int) -> list[Bound]:
    bounds = []
    for name in ("SIGINT", "SIGTERM") if count else ():
        num_seen, slowest = signalled(name, count)
        bounds.append(Bound(f"{name} while driving: zero seen by the vehicle, of {count}", count, num_seen, "", True))
        bounds.append(Bound(f"{name}: slowest zero", 0.2, slowest, "s"))
    return bounds
