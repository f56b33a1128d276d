"""The tour of 490 m through the simulator's city by one camera: taught once, driven again on another day.

In one process and without messages: the same mapper, localiser and follower as in the nodes, in lock-step. The map is
made of ideal RGB-D spheres; `sphere_nav demo --path tour --traffic` is the whole chain with six cameras and stereo.
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Bound, Headline, Report
from benchmarks.room import MemoryMap
from cycab_sim.params import SimParams
from cycab_sim.simulator import Simulator
from cycab_sim.vehicle import VehicleCommand
from dense_localizer.localizer import Localizer
from dense_localizer.params import LocalizerParams
from path_follower.follower import Follower
from path_follower.modes import FollowerState
from path_follower.params import FollowerParams
from path_follower.path import Pose2
from path_follower.reasons import describe
from path_follower.taught import reference_path, taught_speeds
from sphere_mapping.mapper import Mapper
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.params import build
from sphere_nav.spheres.sphere import Sphere
from sphere_nav_tools.cli.demo.demo import BUSY, OTHER_DAY, TOUR
from sphere_nav_tools.cli.demo.report import distances_from_path

HELP = "490 m through a city with traffic, pedestrians and a change of light (takes a quarter of an hour)"
STEP_NS = 10_000_000
TEACH = {"mode": "teach", "camera.period": 0.0, "capture.distance": 1.0, "sphere.width": 1024}
DRIVE = {"mode": "drive", "sphere.width": 0, "camera.size": "512,384", "camera.period": 0.2}
HALTED = (FollowerState.STOPPING, FollowerState.STOPPED)
MAX_SECONDS = 1000.0  # of simulated time, after which a drive is given up
QUICK_WAY = 12.0  # m of the tour


@dataclass
class Taught(MemoryMap):
    """A map in memory, the taught poses T_map_base with their stamps, and where the car truly went (N, 2) m."""

    stamps_ns: NDArray[np.int64]
    poses: SE3
    truth: Array
    num_lost: int


@dataclass
class Driven:
    """Where the car truly went (N, 2) m, what the localiser said how often, how the follower ended."""

    truth: Array
    states: Counter[str] = field(default_factory=Counter)
    stops: int = 0
    end: str = ""


def run(options: argparse.Namespace) -> Report:
    """Teach, drive, compare."""
    way = QUICK_WAY if options.size == "quick" else np.inf
    common = {"seed": options.seed} | TOUR | BUSY
    taught = teach(Simulator(build(SimParams, common | TEACH)), way)
    driven = drive(Simulator(build(SimParams, common | OTHER_DAY | DRIVE)), taught)
    along, lateral = distances_from_path(driven.truth, taught.truth)
    length = float(np.linalg.norm(np.diff(taught.truth, axis=0), axis=1).sum())
    rmse, worst = float(np.sqrt(np.mean(lateral**2))), float(np.abs(lateral).max())
    notes = [
        f"{length:.0f} m taught, {len(taught.graph)} key spheres, {taught.num_lost} spheres lost;"
        f" localiser {dict(driven.states)}; end {driven.end}"
    ]
    of = Headline("drives and missions", f"{length:.0f} m of a city on another day, by one camera")
    bounds = [
        Bound("drive by one camera, lateral RMSE", 6.0, 100 * rmse, "cm", headline=of),
        Bound("the same, largest", 25.0, 100 * worst, "cm"),
        Bound("the same, share driven", 0.98, float(along.max()) / length, "", is_minimum=True),
        Bound("the same, stops on the way", 0, driven.stops, ""),
    ]
    return Report("long_drive", bounds=bounds, notes=notes)


def teach(simulator: Simulator, way: float) -> Taught:
    """Let the simulator's driver drive up to `way` m, and map what the sphere on the roof sees."""
    T_base_sphere = simulator.mounts["sphere"].T_base_camera
    mapper, truth, num_lost = Mapper(T_map_first=T_base_sphere), [], 0
    while not simulator.is_taught and simulator.driver.distance < way:
        if "sphere" in simulator.take_due():
            frame = simulator.capture("sphere")
            sphere = Sphere(frame.image, frame.range_m, frame.camera, frame.stamp_ns)  # type: ignore[arg-type]
            num_lost += mapper.add(sphere, simulator.odometry.T_odom_base @ T_base_sphere).T_map_sphere is None
        truth.append((simulator.vehicle.state.x, simulator.vehicle.state.y))
        simulator.step(simulator.teach_command(), STEP_NS)
    mapper.keep_end()
    mapper.close_loops()
    stamps, poses = zip(*mapper.trajectory(), strict=True)
    T_map_base = SE3(np.stack([(pose @ T_base_sphere.inverse()).matrix for pose in poses]))
    return Taught(mapper.graph, np.array(stamps), T_map_base, _moved(truth), num_lost)


def drive(simulator: Simulator, taught: Taught) -> Driven:
    """Follow the taught path by the camera alone."""
    params = FollowerParams()
    xy, yaw = taught.poses.translation[:, :2], np.asarray(taught.poses.yaw)
    speeds = taught_speeds(xy, taught.stamps_ns)
    path = reference_path(xy, yaw, speeds, path=params.path, driving=params.speed, vehicle=params.vehicle)
    localizer, follower = Localizer(LocalizerParams(), taught), Follower(params, path)
    T_camera_base = simulator.mounts["camera"].T_base_camera.inverse()
    localizer.search.T_base_body = simulator.mounts["camera"].T_base_camera
    driven, truth, command, state = Driven(np.zeros((0, 2))), [], VehicleCommand(), FollowerState.IDLE
    answer = follower.tick(simulator.time_ns)
    while simulator.time_ns < MAX_SECONDS * 1e9 and state is not FollowerState.FINISHED:
        now = simulator.time_ns
        if "camera" in simulator.take_due():
            frame = simulator.capture("camera")
            estimate = localizer.update(frame.image, frame.camera, now)
            localized = str(estimate.status.state)
            driven.states[f"{localized} {estimate.status.reason}".strip()] += 1
            if estimate.T_map_camera is not None:
                pose = Pose2.of(estimate.T_map_camera @ T_camera_base)
                answer = follower.update(pose, simulator.odometry.speed, now, localized)
                if state is FollowerState.IDLE and localized == "TRACKING":
                    follower.start(now)
            else:
                answer = follower.tick(now)
            driven.stops += answer.status.state in HALTED and state not in HALTED
            state, command = answer.status.state, VehicleCommand(answer.speed, answer.yaw_rate)
            if state is FollowerState.STOPPED:
                break
        truth.append((simulator.vehicle.state.x, simulator.vehicle.state.y))
        simulator.step(command, STEP_NS)
    driven.truth, driven.end = _moved(truth), f"{state} {describe(answer.status.verdict)}".strip()
    return driven


def _moved(points: list[tuple[float, float]]) -> Array:
    """Return the points at which the car was moving (N, 2)."""
    xy = np.array(points)
    return xy[np.concatenate([[True], np.linalg.norm(np.diff(xy, axis=0), axis=1) > 1e-4])]
