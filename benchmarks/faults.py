"""What happens in each fault of a drive, and how fast: the follower in lock-step; makes docs/faults.md.

Vehicle, time and messages are simulated, without DDS: a localiser that knows the truth up to noise answers 10 images a
second, 50 ms late, with the states, reasons and ages that `dense_localizer` gives. Faults begin at a random instant
between two images, at full speed (1.4 m/s). The time to zero command counts from there. Signals go to real processes
over real DDS.
"""

from __future__ import annotations

import argparse
import logging
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from std_msgs.msg import Bool

from benchmarks.fault_processes import signalled
from benchmarks.report import Bound, Report, Table
from cycab_sim.params import ActuationParams, VehicleParams
from cycab_sim.vehicle import Command, Vehicle, VehicleState
from localization.status import State, Status
from node_kit.conversions import poses_to_path, se3_to_pose_with_covariance, status_to_message
from node_kit.replay import OfflineBus
from path_follower.node import PathFollowerNode
from sphere_geometry import SE3

HELP = "stops: time to zero command for each fault, false stops of a long drive; writes docs/faults.md"
SECOND, STEP_NS, PERIOD_NS, LATENCY_NS = 1_000_000_000, 10_000_000, 100_000_000, 50_000_000
LIMIT = 0.85  # s from the loss of the pose to zero command
NOISE, YAW_NOISE = 0.01, 0.003  # m, rad
Image = list[tuple[str, Any]]  # what the localiser says to one image: topic and message
Change = Callable[["Drive", Image, float], Image]


@dataclass
class Fault:
    """Changes what the localiser says to an image; `begin` and `end` are called there. `stops`: the vehicle must."""

    number: str
    name: str
    change: Change = lambda drive, image, age: image
    begin: Callable[[Drive], None] = lambda drive: None
    end: Callable[[Drive], None] = lambda drive: None
    stops: bool = True


class Drive:
    """A straight drive at full speed."""

    def __init__(self, seed: int, *, length: float = 200.0, dropped: float = 0.0) -> None:
        self.rng = np.random.default_rng(seed)
        self.bus = OfflineBus()
        self.node = self.bus.add(PathFollowerNode, {"enable_stamped_cmd_vel": True})
        self.vehicle = Vehicle(VehicleState(), VehicleParams(), ActuationParams())
        self.command, self.now, self.dropped = Command(), SECOND, dropped
        self.fault: Fault | None = None
        self.fault_ns, self.num_stops, self.aside = 0, 0, 0.0
        self.pending: list[tuple[int, Image]] = []
        self.commands: list[tuple[int, float]] = []
        path = [(0, SE3.from_planar(x, 0.0, 0.0)) for x in np.arange(0.0, length, 0.5)]
        list(self.bus.advance(self.now))
        self.bus.deliver("/reference_path", poses_to_path(path, self.now, "map"))

    @property
    def follower(self) -> Any:
        """The algorithm in the node."""
        return self.node.follower  # type: ignore[attr-defined]

    def say(self, state: str, reason: str = "", age: float = 0.0, pose: SE3 | None = None, stamp: int = 0) -> Image:
        """Return what the localiser says."""
        stamp = stamp or self.now
        status = status_to_message(Status(State(state), reason, age=age), stamp, "map")
        found = [("/pose", se3_to_pose_with_covariance(pose, 1e-4 * np.eye(6), stamp, "map"))] if pose else []
        return [*found, ("/status", status)]

    def see(self) -> SE3:
        """Return the true pose with noise."""
        s, noise = self.vehicle.state, self.rng.normal(size=3) * (NOISE, NOISE, YAW_NOISE)
        return SE3.from_planar(s.x + noise[0], s.y + noise[1], s.yaw + noise[2])

    def run(self, seconds: float) -> None:
        """Let time pass."""
        end = self.now + round(seconds * SECOND)
        while self.now < end:
            if self.now % PERIOD_NS == 0 and self.rng.random() >= self.dropped:
                image, age = self.say("TRACKING", pose=self.see()), (self.now - self.fault_ns) / SECOND
                if self.fault is not None:
                    image = self.fault.change(self, image, age)
                self.pending.append((self.now + LATENCY_NS, image))
            said = list(self.bus.advance(self.now))
            while self.pending and self.pending[0][0] <= self.now:
                for topic, message in self.pending.pop(0)[1]:
                    self.bus.deliver(topic, message)
                    said += self.bus.settle()
            for item in said:
                if item.topic == "/cmd_vel":
                    twist = item.message.twist
                    self._obey(twist.linear.x, twist.angular.z)
            self.vehicle.step(self.command, STEP_NS / SECOND)
            self.aside = max(self.aside, abs(self.vehicle.state.y))
            self.now += STEP_NS

    def _obey(self, speed: float, yaw_rate: float) -> None:
        self.num_stops += speed == 0.0 and self.command.speed != 0.0
        self.command = Command(speed, yaw_rate)
        self.commands.append((self.now, speed))

    def start(self) -> str:
        """Arm; return why not."""
        answer = self.node.shell.call("start")  # type: ignore[attr-defined]
        return "" if answer.success else str(answer.message).partition(":")[0]


@dataclass
class Outcome:
    """Times to zero in s (infinite: it drove on), and what else was seen."""

    fault: Fault
    to_zero: list[float] = field(default_factory=list)
    reasons: set[str] = field(default_factory=set)
    recoveries: set[str] = field(default_factory=set)
    aside: float = 0.0

    def suffer(self, seed: int) -> None:
        """Drive, let the fault begin, end it, and see whether the vehicle goes on."""
        drive = Drive(seed)
        drive.run(0.5)
        if refusal := drive.start():
            raise RuntimeError(f"start: {refusal}")
        drive.run(3.0 + float(drive.rng.integers(0, 10)) / 100)
        drive.fault, drive.fault_ns, drive.commands, drive.num_stops = self.fault, drive.now, [], 0
        drive.aside = 0.0
        self.fault.begin(drive)
        drive.run(2.5)
        moving = [at for at, speed in drive.commands if speed != 0.0]
        stopped = [at for at, speed in drive.commands if at > max(moving, default=0) and speed == 0.0]
        self.to_zero.append((stopped[0] - drive.fault_ns) / SECOND if stopped else math.inf)
        verdict = drive.follower.mode.verdict
        self.reasons.add(str(verdict.reason) or "drives on")
        self.aside = max(self.aside, drive.aside)
        self.fault.end(drive)
        drive.fault = None
        drive.run(1.0)
        self.recoveries.add(
            "by itself" if drive.follower.mode.is_driving else f"`start`: {drive.start() or 'drives again'}"
        )

    @property
    def row(self) -> tuple[str, ...]:
        """Return the cells of the table."""
        times = [t for t in self.to_zero if math.isfinite(t)]
        cells = [f"{f(times):.2f}" for f in (min, np.median, max)] if times else ["–"] * 3
        reasons, ends = ", ".join(sorted(self.reasons)), "; ".join(sorted(self.recoveries))
        return (self.fault.number, self.fault.name, reasons, *cells, f"{self.aside:.2f}", ends)


def _stamped(offset: Callable[[int], int]) -> Change:
    return lambda drive, image, age: drive.say("TRACKING", pose=drive.see(), stamp=max(offset(drive.now), 1))


def _for(seconds: float, change: Change) -> Change:
    """Return a change that ends after a while."""
    return lambda drive, image, age: change(drive, image, age) if age <= seconds else image


def _blind(reason: str, until: float = 0.5) -> Change:
    """Predicted poses while no image fits, then LOST, as the localiser does."""

    def change(drive: Drive, image: Image, age: float) -> Image:
        age += 0.1
        return drive.say("DEGRADED", reason, age, drive.see()) if age <= until else drive.say("LOST", reason, age)

    return change


def _frozen(drive: Drive, image: Image, age: float) -> Image:
    """Two repeated images still look like a pose, at the third the localiser says FROZEN."""
    return drive.say("TRACKING", pose=drive.see()) if age < 0.2 else drive.say("DEGRADED", "FROZEN", 0.1, drive.see())


def _moved(x: float, y: float) -> Change:
    return lambda drive, image, age: drive.say("TRACKING", pose=SE3.from_planar(x, y, 0.0) @ drive.see())


def _no_number(drive: Drive, image: Image, age: float) -> Image:
    for _, message in image[:1]:
        message.pose.pose.position.x = math.nan
    return image


def _second(drive: Drive) -> None:
    drive.node.publishers_of = lambda topic: ["/dense_localizer", "/other"]  # type: ignore[method-assign]


def _alone(drive: Drive) -> None:
    drive.node.publishers_of = lambda topic: ["/dense_localizer"]  # type: ignore[method-assign]


def _press(is_pressed: bool) -> Callable[[Drive], None]:
    return lambda drive: drive.bus.deliver("/emergency_stop", Bool(data=is_pressed))


FAULTS = (
    Fault("F1", "every third image lost", lambda d, i, a: [] if d.now // PERIOD_NS % 3 == 0 else i, stops=False),
    Fault("F1", "three images lost", lambda d, i, a: i if a > 0.3 else [], stops=False),
    Fault("F1", "ten images lost", lambda d, i, a: i if a > 1.0 else []),
    Fault("F2", "camera frozen", _frozen),
    Fault("F3, F16", "camera silent, localiser alive but silent", lambda d, i, a: []),
    Fault("F4", "stamps one hour ahead", _stamped(lambda now: now + 3600 * SECOND)),
    Fault("F4", "stamps 5 s ahead", _stamped(lambda now: now + 5 * SECOND)),
    Fault("F4", "stamps 5 s back", _stamped(lambda now: now - 5 * SECOND)),
    Fault("F4", "stamps of zero", _stamped(lambda now: 1)),
    Fault("F4", "one pose one hour ahead", _for(0.1, _stamped(lambda now: now + 3600 * SECOND)), stops=False),
    Fault("F5", "clock goes backwards", begin=lambda d: d.node.clock_jumped()),
    Fault("F7", "poses that are no numbers", _no_number),
    Fault("F8, F9, F10", "no image fits (BAD_INFO, LOW_TEXTURE, OUTLIERS)", _blind("OUTLIERS")),
    Fault("F8, F9, F10", "two images do not fit", _for(0.2, _blind("OUTLIERS")), stops=False),
    Fault("F11", "kidnapped 15 m, the localiser blind", _blind("JUMP_REJECTED")),
    Fault("F11", "kidnapped 15 m, the localiser follows", _moved(15.0, 0.0)),
    Fault("F11", "pose 1.5 m aside", _moved(0.0, 1.5)),
    Fault("F15", "localiser killed", lambda d, i, a: []),
    Fault("F15", "localiser LOST", lambda d, i, a: d.say("LOST", "OUTLIERS", a)),
    Fault("F15", "a second publisher of the pose", begin=_second, end=_alone),
    Fault("F16", "poses one second late", _stamped(lambda now: now - SECOND)),
    Fault("F24", "emergency stop", begin=_press(True), end=_press(False)),
)  # fmt: skip
ELSEWHERE = """\
Held by tests, not by drives: F6 a camera of the rig missing (`test/sphere_mapping`), F12 initial pose refused
(`test/nodes/test_dense_localizer.py`), F13 and F14 damaged maps and bags (`test/node_kit`), F17 QoS and F18 tf in words
(`test/node_kit`), F19 odometry (`test/mcl_depth`, `test/dense_localizer`), F20 replay without tf_static
(`test/node_kit/test_replay.py`), F21 parameters (`test/node_kit/test_parameters.py`), F22 crossings, cusps, bad paths
(`test/path_follower`), F25 unauthorised publishers (SROS2, not measured here)."""
COLUMNS = ("fault", "what", "reason", "zero after min [s]", "median", "max", "aside [m]", "drives again")


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--fault-runs", type=int, default=8, help="drives of each fault (%(default)s)")
    parser.add_argument("--fault-hours", type=float, default=2.0, help="simulated hours of driving (%(default)s)")
    parser.add_argument("--fault-signals", type=int, default=200, help="SIGINTs, and SIGTERMs (%(default)s)")
    parser.add_argument("--fault-page", type=Path, help="write the tables to this page (docs/faults.md)")


def run(options: argparse.Namespace) -> Report:
    """Suffer every fault, drive for hours, end follower processes by signals."""
    logging.getLogger("sphere_nav").setLevel(logging.CRITICAL)
    outcomes = list(_outcomes(2 if options.quick else options.fault_runs))
    hours = 0.05 if options.quick else options.fault_hours
    false_stops, growth = nominal(hours)
    lost = [max(o.to_zero) for o in outcomes if o.fault.stops]
    drove_on = sum(math.isfinite(t) for o in outcomes if not o.fault.stops for t in o.to_zero)
    bounds = [
        Bound("loss of the pose to zero command, largest of all faults", LIMIT, max(lost), "s"),
        Bound("stops in faults that should be driven through", 0, drove_on, ""),
        Bound(f"false stops in {hours:g} h at 10 Hz, 10 % of the images lost", 1, false_stops, ""),
        Bound("growth of memory over that drive", 5.0, growth, "MB/h"),
    ]
    table = Table("Faults", COLUMNS, [o.row for o in outcomes])
    count = 3 if options.quick else options.fault_signals
    for name in ("SIGINT", "SIGTERM") if count else ():
        num_seen, slowest = signalled(name, count)
        bounds.append(Bound(f"{name} while driving: zero seen by the vehicle, of {count}", count, num_seen, "", True))
        bounds.append(Bound(f"{name}: slowest zero", 0.2, slowest, "s"))
    report = Report("faults", [table], bounds, [ELSEWHERE])
    if options.fault_page:
        made = "Generated by `python -m benchmarks faults --fault-page docs/faults.md`."
        head = f"# Faults\n\n{(__doc__ or '').strip()}\n\n{made}\n\n"
        options.fault_page.write_text(head + report.markdown() + "\n", encoding="utf-8")
    return report


def _outcomes(runs: int) -> Iterator[Outcome]:
    for fault in FAULTS:
        outcome = Outcome(fault)
        for seed in range(runs):
            outcome.suffer(1000 + seed)
        yield outcome


def nominal(hours: float) -> tuple[int, float]:
    """Drive with a tenth of the images lost; return stops, and growth of memory in MB/h after a fifth."""
    drive = Drive(7, length=hours * 3600 * 1.4 + 50.0, dropped=0.1)
    drive.run(0.5)
    while drive.start():
        drive.run(0.3)
    drive.run(5.0)
    drive.num_stops, before = 0, 0.0
    for part in range(10):
        if part == 2:
            before = _memory_mb()
        drive.run(hours * 360.0)
        drive.commands.clear()
    return drive.num_stops, (_memory_mb() - before) / (0.8 * hours)


def _memory_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[1])
    return pages * 4096 / 1e6
