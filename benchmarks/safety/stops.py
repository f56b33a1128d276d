"""Stops at random moments, over DDS: real follower and navigator, a base that obeys, and a cause that comes and goes.

After each answered stop, pause or press (and release) the base may ramp down, and nothing else until the next start.
"""

from __future__ import annotations

import argparse
import random
import threading
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from rclpy.action import ActionClient
from sphere_nav_msgs.action import Navigate
from sphere_nav_msgs.srv import LoadTrajectory
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage
from tqdm import tqdm

from benchmarks.base import LENGTH, PATIENCE, Base, write_straight
from benchmarks.report import Bound, Headline, Report, Table
from path_follower.routes.building import TaughtDrive, build_network
from path_follower.routes.network import Curve, Spot
from path_follower.routes.network_file import write_network
from sphere_nav.ros import qos
from sphere_nav_tools.cli.operate.link import Link
from sphere_nav_tools.cli.processes import Processes

TRIALS, QUICK_TRIALS = 200, 12
RULES, WAYS = ("moving", "standing"), ("path", "mission")
STOPS, CAUSES = ("stop", "pause", "press", "page"), ("none", "pose", "lost", "obstacle")
WATCH = 4.0  # s after the answer, in which the cause goes
RAMP = 3.3  # s, gently from 1.4 m/s, and until the answer and the last command are heard
ON_ITS_WAY = 0.1  # s after the answer: a command of before it may be heard


def run(options: argparse.Namespace) -> Report:
    """Run the trials, half of them by missions, and half under each rule of `safety.resume`."""
    count = QUICK_TRIALS if options.size == "quick" else TRIALS
    draw, rows, moved, worst = random.Random(options.seed), [], 0, 0.0
    for rule in RULES:
        found = session(rule, count // len(RULES), draw, options.folder / rule)
        for way in WAYS:
            gained = [gain for kind, gain in found if kind == way]
            rows.append((way, rule, str(len(gained)), str(sum(gain > 0.0 for gain in gained)), f"{max(gained):.2f}"))
            moved += sum(gain > 0.0 for gain in gained)
            worst = max(worst, *gained)
    columns = ("driven by", "safety.resume", "moments", "moved after the stop", "largest speed gained, m/s")
    told = f"{count} stops, pauses and presses at random moments over DDS"
    bounds = [
        Bound("drove off after an answered stop", 0, moved, "", headline=Headline("time to zero", told)),
        Bound("largest speed gained after an answered stop", 0, worst, "m/s"),
    ]
    return Report("stops", [Table("Stops at random moments", columns, rows)], bounds)


def session(rule: str, count: int, draw: random.Random, folder: Path) -> list[tuple[str, float]]:
    """Return for each trial how it was driven, and by how many m/s the speed grew after the answer."""
    folder.mkdir()
    x = np.arange(0.0, LENGTH, 0.1)
    network = build_network([TaughtDrive(Curve(x, 0 * x, 0 * x, 0 * x + 1.4))])
    write_network(folder / "routes.geojson", network.with_place("end", Spot(max(network.edges), LENGTH - 5.0)))
    path = write_straight(folder)
    with Processes(folder) as nodes:
        nodes.start("path_follower", {"trajectory": str(path), "safety.resume": rule})
        nodes.start("route_navigator", {"network": str(folder / "routes.geojson")})
        vehicle = StoppedBase(path)
        try:
            trials = tqdm(range(count), desc=rule, unit="stop", mininterval=20.0)
            return [trial(vehicle, WAYS[i % 2], draw) for i in trials]
        finally:
            vehicle.page.close()
            vehicle.close()


class StoppedBase(Base):
    """The base, the scanner, and an operator."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.goal: Any = None
        self.file, self.has_obstacle = str(path), False
        self.calls = {name: self.node.create_client(Trigger, f"path_follower/{name}") for name in ("stop", "pause")}
        self.load = self.node.create_client(LoadTrajectory, "path_follower/load_trajectory")
        self.goals = ActionClient(self.node, Navigate, "navigate")
        self.fixed = self.node.create_publisher(TFMessage, "/tf_static", qos.LATCHED)
        mounting = TransformStamped(child_frame_id="laser")
        mounting.header.frame_id = "base_link"
        self.fixed.publish(TFMessage(transforms=[mounting]))
        self.page = Link()  # an operator's page, which has begun nothing of what it stops

    def speak(self) -> None:
        """Say what the base says, and what the scanner sees."""
        super().speak()
        ranges = np.full(181, np.inf)
        ranges[85:96] = 2.0 if self.has_obstacle else np.inf
        self.scan(ranges, np.pi / 180)

    def answer_to(self, future: Any) -> Any:
        """Return what was answered."""
        if not self.live(PATIENCE, future.done):
            raise RuntimeError("expected an answer, found none")
        return future.result()

    def stop_by(self, stop: str) -> bool:
        """Stop in one of the ways; return whether it was answered with success."""
        if stop == "press":
            self.is_pressed = True
            self.live(0.3)
            self.is_pressed = False
            return True
        if stop == "page":
            answers: list[str] = []
            asking = threading.Thread(target=lambda: answers.append(self.page.command("stop")))
            asking.start()
            self.live(PATIENCE, lambda: bool(answers))
            asking.join()
            return "NOT CONFIRMED" not in answers[0] and "NOT KNOWN" not in answers[0]
        return bool(self.answer_to(self.calls[stop].call_async(Trigger.Request())).success)

    def begin(self, way: str) -> None:
        """Ask for motion, again and again, until it was accepted."""
        clients = (self.load, self.start, *self.calls.values())
        self.live(PATIENCE, lambda: all(c.service_is_ready() for c in clients) and self.goals.server_is_ready())
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            self.live(0.3)
            if way == "mission":
                self.goal = self.answer_to(self.goals.send_goal_async(Navigate.Goal(place="end")))
                accepted = self.goal.accepted
            else:
                self.answer_to(self.load.call_async(LoadTrajectory.Request(path=self.file)))
                started = self.answer_to(self.start.call_async(Trigger.Request()))
                accepted, self.reason = started.success, started.message
            if accepted:
                return
        raise RuntimeError(f"expected the {way} to begin, found {self.reason}")


def trial(vehicle: StoppedBase, way: str, draw: random.Random) -> tuple[str, float]:
    """Drive, let a cause come, stop at a random moment, let the cause go; return the speed gained after the answer."""
    vehicle.begin(way)
    vehicle.live(draw.uniform(0.0, 5.0))
    cause, stop = draw.choice(CAUSES), draw.choice(STOPS)
    vehicle.is_silent, vehicle.has_obstacle = cause == "pose", cause == "obstacle"
    vehicle.state = "LOST" if cause == "lost" else "TRACKING"
    if cause != "none":
        vehicle.live(draw.uniform(0.0, 3.0))
    if not vehicle.stop_by(stop):  # a pause of what stands for good: nothing to hold
        vehicle.stop_by("stop")
    answered = time.monotonic()
    vehicle.live(draw.uniform(0.0, 0.5 * WATCH))
    vehicle.is_silent, vehicle.has_obstacle, vehicle.state = False, False, "TRACKING"
    vehicle.live(WATCH - (time.monotonic() - answered))
    speeds = [speed for at, speed in vehicle.commands if at - answered > ON_ITS_WAY]
    gained = max([max(b - a, 0.0) for a, b in pairwise(speeds)], default=0.0)
    late = [speed for at, speed in vehicle.commands if at - answered > RAMP]
    if way == "mission":  # leave no mission behind, and no pause
        vehicle.answer_to(vehicle.goal.cancel_goal_async())
    vehicle.answer_to(vehicle.calls["stop"].call_async(Trigger.Request()))
    vehicle.live(1.0)
    return way, max([gained, *late])
