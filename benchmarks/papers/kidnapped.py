"""`kidnapped`: put down along the path; `mcl_depth` finds the place, `dense_localizer` takes over, the car drives.

Until the place is found a human drives, as `mcl_depth` needs some metres. All starts are in one run of the nodes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import TwistStamped
from matplotlib import pyplot as plt
from nav_msgs.msg import Odometry
from sphere_nav_msgs.msg import LocalizationStatus
from sphere_nav_msgs.srv import LoadTrajectory

from benchmarks.papers.drives import ALL_AROUND, ASIDE, NEAR, PaperDrive, beside, teleport
from benchmarks.papers.result import JudgedFigure
from cycab_sim.driver import PurePursuitDriver
from cycab_sim.params import SimParams
from cycab_sim.vehicle import VehicleState
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.params import build
from sphere_nav.ros import qos
from sphere_nav.ros.bags import BagReader
from sphere_nav.ros.conversions import pose_to_se3, stamp_ns
from sphere_nav_tools.cli.demo.demo import DRIVE_TOPICS, has_ended
from sphere_nav_tools.cli.demo.plots import save_figure
from sphere_nav_tools.cli.demo.report import ESTIMATE, read_truth
from sphere_nav_tools.cli.demo.watch import DriveMonitor
from sphere_nav_tools.offline.pose_bags import read_poses

BY_HAND = 30.0  # m after which a start counts as not found
BY_ITSELF = 10.0  # m that are driven by the follower
TURNED = 10.0  # deg from the path at most
RIGHT = 0.3  # m that dense_localizer may be off
COARSE = "/mcl/pose"


@dataclass
class Start:
    """One start: its pose in the world, and stamps of its stages, ns; `taken`: the follower drives, 0 for never."""

    along: float
    left: float
    turned: float
    begun: int = 0
    taken: int = 0
    ended: int = 0


def draw_starts(length: float, seed: int, count: int) -> list[Start]:
    """Draw places along a path of `length` m, with room for what is driven there."""
    rng = np.random.default_rng([seed, 41])
    room = max(length - BY_HAND - BY_ITSELF, 1.0)
    return [Start(*rng.uniform((0.0, -ASIDE, -TURNED), (room, ASIDE, TURNED)).tolist()) for _ in range(count)]


class HandOver:
    """Between follower and car: a human's commands in place of the follower's, or those, or for a while none.

    A command waits for the truth and for `mcl_depth` of its image: nobody is overtaken on a slow computer.
    """

    def __init__(self, watch: DriveMonitor, human: PurePursuitDriver) -> None:
        self.human, self.speed = human, 0.0
        self.is_by_hand, self.is_braking, self.is_held = True, False, True
        self._waiting: TwistStamped | None = None
        self._state, self._told_ns, self._answered_ns, self._passed_ns = VehicleState(), 0, 0, 0
        self._commands = watch.node.create_publisher(TwistStamped, "cmd_vel", qos.DEEP)
        subscribe = watch.node.create_subscription
        subscribe(TwistStamped, "follower/cmd_vel", self._on_command, qos.DEEP)
        subscribe(LocalizationStatus, "mcl/status", self._on_answer, qos.DEEP)
        subscribe(Odometry, "ground_truth/odometry", self._on_truth, qos.DEEP)

    @property
    def now_ns(self) -> int:
        """The stamp of the image at which time stands, as its answer is held; 0 while time passes."""
        is_standing = self.is_held and self._waiting is not None and self._answered_ns >= stamp_ns(self._waiting)
        return self._answered_ns if is_standing else 0

    def release(self) -> None:
        """Let time pass."""
        self.is_held = False
        self._pass_on()

    def _on_command(self, message: TwistStamped) -> None:
        last_ns = self._passed_ns if self._waiting is None else stamp_ns(self._waiting)
        if stamp_ns(message) > last_ns:  # else it repeats an answer
            self._waiting = message
        self._pass_on()

    def _on_answer(self, message: LocalizationStatus) -> None:
        self._answered_ns = stamp_ns(message)
        self._pass_on()

    def _on_truth(self, message: Odometry) -> None:
        T_world_base, self.speed = pose_to_se3(message.pose.pose), message.twist.twist.linear.x
        x, y, _ = map(float, T_world_base.translation)
        self._state, self._told_ns = VehicleState(x, y, float(T_world_base.yaw)), stamp_ns(message)
        self._pass_on()

    def _pass_on(self) -> None:
        message = self._waiting
        if self.is_held or message is None or min(self._told_ns, self._answered_ns) < stamp_ns(message):
            return
        if self.is_by_hand:
            wanted = self.human.command(self._state)
            factor = 0.0 if self.is_braking else 1.0
            message.twist.linear.x, message.twist.angular.z = factor * wanted.speed, factor * wanted.yaw_rate
        self._waiting, self._passed_ns = None, stamp_ns(message)
        self._commands.publish(message)


class Kidnapped(PaperDrive):
    """From nowhere to a drive, many times."""

    purpose = "put down along the path: mcl_depth finds the place, dense_localizer takes over, the car drives"
    simulator: Mapping[str, Any] = ALL_AROUND | {"clock.pause_at": 0.0}
    localizer: Mapping[str, Any] = {"automatic": False}  # it searches where mcl_depth says
    topics: Mapping[str, Mapping[str, str]] = {
        "dense_localizer": {"other/pose": "mcl/pose"},
        "mcl_depth": {"other/pose": "pose"} | {name: f"mcl/{name}" for name in ("pose", "odometry", "status")},
        "path_follower": {"cmd_vel": "follower/cmd_vel"},
    }
    recorded = f"{DRIVE_TOPICS} /mcl/pose /mcl/status"
    num_starts = 20

    def localizers(self) -> dict[str, Mapping[str, Any]]:
        """Return both: one in the map, one in a survey of the place."""
        return super().localizers() | {"mcl_depth": self.survey() | {"publish_tf": False}}

    def place(self, watch: DriveMonitor) -> None:
        """Leave the car where it is: it is put down in `accompany`."""

    def depart(self, watch: DriveMonitor) -> None:
        """Take the wheel; time passes from now on."""
        watch.wait_for("path_follower/start")
        params = build(SimParams, self.simulation)
        self.hand_over = HandOver(watch, PurePursuitDriver(self.path, params.teach, params.seed))

    def accompany(self, watch: DriveMonitor) -> None:
        """Do all starts."""
        self.starts = draw_starts(self.path.length, self.seed, self.num_starts)
        for number, start in enumerate(self.starts, 1):
            self.kidnap(watch, start)
            self.drive_from(watch, start)
            print(f"start {number} of {len(self.starts)}: {watch.describe()}", flush=True)

    def kidnap(self, watch: DriveMonitor, start: Start) -> None:
        """Put the car down while time stands, and let all forget where it was."""
        hand = self.hand_over
        hand.is_held = True
        watch.wait("standstill of time", lambda: hand.now_ns > 0, is_moving=False)
        start.begun = hand.now_ns
        teleport(watch, beside(self.path, start.along, start.left, start.turned))
        watch.call("dense_localizer/reset")
        watch.call("mcl_depth/reset")
        watch.call("path_follower/load_trajectory", LoadTrajectory.Request(path=str(self.reference())))
        watch.localizer, hand.human.distance = "", start.along
        hand.is_by_hand, hand.is_braking = True, False
        hand.release()

    def drive_from(self, watch: DriveMonitor, start: Start) -> None:
        """Drive by hand until the place is found, then by the follower."""
        hand = self.hand_over

        def is_over() -> bool:
            return watch.localizer.startswith("TRACKING") or hand.human.distance > start.along + BY_HAND

        watch.wait("place found", is_over, is_moving=True)
        hand.is_braking = True
        watch.wait("standstill", lambda: abs(hand.speed) < 0.01, is_moving=False)
        if watch.localizer.startswith("TRACKING"):
            watch.insist("path_follower/start")
            start.taken, hand.is_by_hand, travelled = watch.now_ns, False, watch.travelled
            watch.wait("start", lambda: watch.follower.startswith(("DRIVING", "SLOW")), is_moving=False)
            watch.wait(
                "drive", lambda: watch.travelled > travelled + BY_ITSELF or has_ended(watch.follower), is_moving=True
            )
            watch.call("path_follower/stop")
            watch.wait("stop", lambda: has_ended(watch.follower), is_moving=False)
        start.ended = watch.now_ns

    def evaluate(self) -> tuple[list[JudgedFigure], Mapping[str, Any]]:
        """Judge each start by the truth."""
        with self.stage("judge"):
            T_world_map, bag = self.anchor(), self.folder / "drive"
            fine, coarse = (read_any(bag, topic).moved(T_world_map) for topic in (ESTIMATE, COARSE))
            truth = read_truth(bag)
            outcomes = [judge_start(start, truth, fine, coarse) for start in self.starts]
            self.plot(truth, outcomes)
        told = [asdict(start) | outcome for start, outcome in zip(self.starts, outcomes, strict=True)]
        known = [{name: value for name, value in row.items() if np.isfinite(value)} for row in told]
        return kidnap_figures(outcomes), {"starts": known}

    def plot(self, truth: Trajectory, outcomes: list[dict[str, float]]) -> None:
        """Draw from above what was driven by hand and by itself, and the first pose of mcl_depth."""
        figure, axes = plt.subplots(figsize=(8, 8))
        axes.plot(*self.path.at(np.arange(0.0, self.path.length, 0.2))[:, :2].T, "-", color="0.8", linewidth=5)
        for number, (start, outcome) in enumerate(zip(self.starts, outcomes, strict=True)):
            for begin, end, color, name in (
                (start.begun, start.taken or start.ended, "tab:blue", "by hand"),
                (start.taken, start.ended if start.taken else 0, "tab:red", "by itself"),
            ):
                part = truth.positions[(truth.stamps_ns > begin) & (truth.stamps_ns <= end)]
                axes.plot(*part[:, :2].T, "-", color=color, label=name if not number else None)
            axes.plot(*beside(self.path, start.along, start.left, 0.0)[:2], "k^", markersize=6)
            axes.plot(outcome["x"], outcome["y"], "gx", label="first pose of mcl_depth" if not number else None)
        axes.set(
            aspect="equal", adjustable="datalim", xlabel="x [m]", ylabel="y [m]", title="Put down at the triangles"
        )
        axes.grid(alpha=0.3)
        axes.legend()
        save_figure(figure, self.folder / "top_view.png")


def judge_start(start: Start, truth: Trajectory, fine: Trajectory, coarse: Trajectory) -> dict[str, float]:
    """Return of a start: where mcl_depth first was (x, y), errors of both in m, ways in m; NaN where there is none."""
    first, first_off = _errors(_between(coarse, start.begun, start.ended), truth)
    poses, off = _errors(_between(fine, start.begun, start.ended), truth)
    driven, wrong = _between(truth, start.taken or start.ended, start.ended), 0.0
    for index in np.flatnonzero(off > RIGHT):  # the way until the next pose
        until = int(poses.stamps_ns[index + 1]) if index + 1 < len(poses) else start.ended
        wrong += _way(_between(driven, int(poses.stamps_ns[index]) - 1, until))
    x, y = first.positions[0, :2].tolist() if len(first) else (np.nan, np.nan)
    return {
        "x": x,
        "y": y,
        "coarse_m": float(first_off[0]) if len(first) else np.nan,
        "fine_m": float(off.max()) if len(off) else np.nan,
        "by_hand_m": _way(_between(truth, start.begun, start.taken or start.ended)),
        "by_itself_m": _way(driven),
        "wrong_m": wrong,
    }


def kidnap_figures(outcomes: list[dict[str, float]]) -> list[JudgedFigure]:
    """Judge all starts."""
    table = {name: np.array([outcome[name] for outcome in outcomes]) for name in outcomes[0]}
    good = (table["coarse_m"] <= NEAR) & (table["fine_m"] <= RIGHT) & (table["by_itself_m"] >= 0.95 * BY_ITSELF)
    by_hand = float(np.median(table["by_hand_m"]))
    return [
        JudgedFigure("starts", len(outcomes)),
        JudgedFigure("starts found, right, and driven from", 100.0 * float(good.mean()), "%", 100.0, is_minimum=True),
        JudgedFigure("way by itself while the pose was wrong", float(table["wrong_m"].sum()), "m", 0.0),
        JudgedFigure("way by hand until the follower starts, median", by_hand, "m"),
        JudgedFigure("first pose of mcl_depth off, largest", float(np.max(table["coarse_m"])), "m"),
        JudgedFigure("poses of dense_localizer off, largest", float(np.max(table["fine_m"])), "m"),
    ]


def read_any(bag: Path, topic: str) -> Trajectory:
    """Return the poses on a topic; none where there is no such topic, as nothing was published."""
    with BagReader(bag) as reader:
        is_there = topic in reader.topics and reader.topics[topic].count > 0
    return read_poses(bag, (topic,)) if is_there else Trajectory(np.empty(0, np.int64), SE3(np.empty((0, 4, 4))))


def _between(some: Trajectory, begin: int, end: int) -> Trajectory:
    return some[(some.stamps_ns > begin) & (some.stamps_ns <= end)]


def _errors(some: Trajectory, truth: Trajectory) -> tuple[Trajectory, Array]:
    """Return the poses (N,) of which the truth is known, and how far they are from it (N,) m on the ground."""
    at, known = truth.at(some.stamps_ns)
    return some[known], np.hypot(*(some[known].positions - at.positions)[:, :2].T)


def _way(some: Trajectory) -> float:
    return float(some.distances[-1]) if len(some) else 0.0
