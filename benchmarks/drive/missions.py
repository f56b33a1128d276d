"""Missions over a network of 1.1 km in the simulated city: `route_navigator` and `path_follower` on a bus, with a car.

One tour through the city makes the network: around its blocks, by two streets in its middle, one of them both ways, and
over a square. Missions go from one of six places to another, drawn at random; about every 150 m somebody steps before
the car and off again. The nodes, their messages and calls are the real ones; poses are the truth with noise, ten a
second and 50 ms late, so that this measures missions, ways and joints; by a camera, the localiser tells them.
"""

from __future__ import annotations

import argparse
import logging
import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.commands import call
from benchmarks.drive.mission_town import CRUISE, LATENCY_NS, PERIOD_NS, STEP_NS, TOUR, Driven, Town, features, named
from benchmarks.drive.street import rounded_way
from benchmarks.report import Bound, Headline, Report, Table
from cycab_sim.params import SimParams
from cycab_sim.ros.outputs import Outputs
from cycab_sim.simulator import START_NS, Simulator
from cycab_sim.vehicle import VehicleCommand
from dense_localizer.ros.node import DenseLocalizerNode
from path_follower.path import Pose2
from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import Trajectory, read_tum
from sphere_nav.localization.status import State
from sphere_nav.params import build
from sphere_nav.ros.bags import BagWriter
from sphere_nav.ros.bags.recorded import Recorded
from sphere_nav.ros.bags.replay import OfflineBus, OfflineShell, record
from sphere_nav.ros.conversions import pose_to_se3, stamp_ns
from sphere_nav_tools.cli.demo.demo import BUSY, OTHER_DAY, SIMULATION, TEACHING, read_truth
from sphere_nav_tools.offline.routes import map_id_of, read_network_of

WAIT_NS = 30_000_000_000  # of simulated time until the car must know where it is
CITY = SIMULATION | BUSY | {"world": "city", "teach.speed": CRUISE, "capture.distance": 2.0}
FULL, QUICK, BY_CAMERA = 100, 3, 12  # missions
COLUMNS = ("from", "to", "arrived", "m", "contacts", "lateral RMSE m", "stops at joints")


def simulate(seed: int, more: Mapping[str, Any]) -> Simulator:
    """Return the city of a seed, its traffic busy where the tour does not lead."""
    return Simulator(build(SimParams, {**CITY, "seed": seed, **more}), rounded_way(TOUR))


def record_drive(simulator: Simulator, path: Path, length_m: float = np.inf) -> None:
    """Let the simulator's driver drive, so far at most; write what its node would publish into a bag."""
    bus = OfflineBus(start_ns=START_NS)
    outputs = publish_on(bus, simulator)
    with BagWriter(path) as bag:
        while simulator.driver.distance < length_m and not simulator.is_taught:
            bus.now_ns = simulator.time_ns
            for name in simulator.take_due():
                outputs.publish(name)
            for _ in record(bus.settle(), bag, bus):
                pass
            simulator.step(simulator.teach_command(), STEP_NS // 5)


def publish_on(bus: OfflineBus, simulator: Simulator) -> Outputs:
    """Return the simulator's outputs on a bus; its cameras' places are told."""
    outputs = Outputs(OfflineShell(bus, "cycab_sim", {}, {}), simulator)
    outputs.publish_statics()
    return outputs


class Taught:
    """The tour as it was mapped and as it truly was: what is near it in the map, and where that is in the world."""

    def __init__(self, mapped: Trajectory, truth: Trajectory) -> None:
        at, known = truth.at(mapped.stamps_ns)
        self.T_world, self.T_map = at.T_map_body[known], mapped[known].T_map_body
        x, y, _ = self.T_map.translation.T
        self.tree = cKDTree(features(x, y, np.asarray(self.T_map.yaw)))

    def to_world(self, T_map: SE3) -> SE3:
        """Return where a pose of the map truly is, by the nearest taught pose that heads alike."""
        x, y, _ = T_map.translation
        near = int(self.tree.query(features(x, y, T_map.yaw))[1])
        return self.T_world[near] @ self.T_map[near].inverse() @ T_map


class CameraTown(Town):
    """The car in the simulated city: its camera, the localizer, and the nodes of every mission."""

    def __init__(self, folder: Path, seed: int, num_jobs: int) -> None:
        """Let the simulator's driver drive the tour into a bag, and map it."""
        bag, rig, taught, made = (folder / name for name in ("teach", "rig.yaml", "taught.tum", "map"))
        record_drive(simulate(seed, TEACHING | {"rig.file": str(rig)}), bag)
        call("map", bag, "-o", made, "--rig", rig, "--taught", taught, "--anchor", "truth", "--jobs", num_jobs)
        self.taught = Taught(read_tum(taught), read_truth(bag))
        self.states: Counter[str] = Counter()  # of images under way
        self.errors: list[float] = []  # of poses, m
        self.truth: dict[int, SE3] = {}  # T_world_base by the stamp of an image
        super().__init__(folder, seed, named(read_network_of([taught], map_id_of(made))))
        self.simulator = simulate(seed, OTHER_DAY | {"mode": "drive", "noise_seed": seed})
        self.simulator.faults.add("camera", "delayed", LATENCY_NS / 1e9, 0.0, 0.0, self.simulator.time_ns)
        self.simulator.step(VehicleCommand(), STEP_NS)
        self.localizer = self.bus.add(DenseLocalizerNode, {"map": str(made), "every_image": True})
        self.outputs = publish_on(self.bus, self.simulator)
        self.put(self._spot(self.here))

    def placed(self, pose: Pose2) -> Pose2:
        """Return where a pose of the network truly is."""
        return Pose2.of(self.taught.to_world(SE3.from_planar(*pose)))

    def put(self, pose: Pose2) -> None:
        """Put the car down, and wait until it has found the place by itself."""
        self.simulator.teleport(*self.placed(pose))
        self.car = self.simulator.vehicle
        cast("OfflineShell", self.localizer.endpoints).call("reset")
        self.state, end = "", self.bus.now_ns + WAIT_NS
        while self.state != State.TRACKING and self.bus.now_ns < end:
            self.pause(1)

    @property
    def told(self) -> str:
        """How well the localizer did."""
        errors = np.array(self.errors)
        told = f"rms {np.sqrt(np.mean(errors**2)):.4f} m, largest {errors.max():.3f} m"
        return f"images under way: {dict(self.states)}; error of {len(errors)} poses: {told}"

    def sense(self, now: int) -> Iterator[Recorded]:
        """Publish what the sensors measure now, and what of it comes late; yield what is said."""
        yield from self.bus.advance(now)
        for name in self.simulator.take_due():
            if name == "camera":
                self.truth[now] = self.simulator.T_world_base
            self.outputs.publish(name)
        self.outputs.publish_late()
        if now % PERIOD_NS == 0:
            self.bus.publish("/scan", self.scan(now))
        for said in self.bus.settle():
            if said.topic == "/status":
                self.state = said.message.state
                self.states[self.state] += 1
            elif said.topic == "/pose":
                T_world_base = self.taught.to_world(pose_to_se3(said.message.pose.pose))
                off = T_world_base.translation - self.truth.pop(stamp_ns(said.message)).translation
                self.errors.append(float(np.linalg.norm(off)))
            yield said

    def move(self) -> None:
        """Let the car obey for a step."""
        for _ in range(5):
            self.simulator.step(self.command, STEP_NS // 5)


def run(options: argparse.Namespace) -> Report:
    """Drive all missions, one after the other, each from where the last one ended; by a camera, too, in full size."""
    logging.getLogger("sphere_nav").setLevel(logging.CRITICAL)
    report, is_quick = Report("missions", notes=[__doc__ or ""]), options.size == "quick"
    drive_in(Town(options.folder, options.seed), "missions", QUICK if is_quick else FULL, report)
    if not is_quick:
        town = CameraTown(options.folder, options.seed, options.threads)
        drive_in(town, "missions by a camera", BY_CAMERA, report)
        report.notes.append(town.told)
    return report


def drive_in(town: Town, what: str, count: int, report: Report) -> None:
    """Drive so many missions, each is told at once, since all of them take hours by a camera; add the bounds."""
    driven = list[Driven]()
    for _ in range(count):
        driven.append(town.drive())
        print(" | ".join(cells(driven[-1])), file=sys.stderr, flush=True)
    title = f"{what} over {town.length:.0f} m, {len(town.network.edges)} edges"
    report.tables.append(Table(title, COLUMNS, [cells(one) for one in driven]))
    of, arrived = Headline("drives and missions", f"{count} {what} in a city"), sum(one.is_arrived for one in driven)
    report.bounds += [
        Bound(f"{what}: arrived", count, arrived, f"of {count}", True, of),
        Bound(f"{what}: contacts", 0, sum(one.contacts for one in driven), "", headline=of),
        Bound(f"{what}: lateral RMSE", 0.03, rmse([e for one in driven for e in one.lateral]), "m"),
        Bound(f"{what}: stops at joints", 0, sum(one.stops for one in driven), ""),
    ]


def cells(driven: Driven) -> tuple[str, ...]:
    """Return the row of a mission."""
    arrived = "yes" if driven.is_arrived else driven.reason
    numbers = f"{driven.distance:.0f}", str(driven.contacts), f"{rmse(driven.lateral):.3f}", str(driven.stops)
    return driven.start, driven.goal, arrived, *numbers


def rmse(errors: list[float]) -> float:
    """Return the root of the mean square; 0 of nothing."""
    return float(np.sqrt(np.mean(np.square(errors)))) if errors else 0.0
