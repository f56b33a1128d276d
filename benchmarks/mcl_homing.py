"""Path following by motion direction alone (N17 section III-D): its basin, and a path driven in the simulator."""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks import mcl_sites
from benchmarks.machine import describe
from benchmarks.mcl_drives import HEIGHT, PANORAMA, Studio
from benchmarks.mcl_routes import sampled
from benchmarks.report import Bound, Report, Table
from cycab_sim.params import SimCameraParams, SimParams
from cycab_sim.sensors.faults import SECOND
from cycab_sim.simulator import Simulator
from cycab_sim.vehicle import VehicleCommand
from cycab_sim.world.town import Plan, taught_path
from mcl_depth.belief.particles import wrap_angle
from mcl_depth.homing import Homing
from mcl_depth.likeness.comparison import num_alpha_for, visual_features
from mcl_depth.likeness.level_view import level_view
from mcl_depth.likeness.similarity_cache import Comparison
from mcl_depth.params import DirectionParams
from mcl_depth.site import Site
from sphere_nav.geometry.arrays import Array

HELP = "homing: success by offset from the waypoint, and a path of 100 m driven by direction alone"
RADII = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0)  # m
GOOD_DEG = 45.0  # a direction this close to the true one brings the vehicle nearer
PERIOD = 0.4  # between two images of the drive, s
SPEED, GAIN, MAX_RATE = 1.0, 1.0, 0.35  # m/s, 1/s, rad/s
SETTINGS = {"cache.max_distance": 0.25}
MAX_TIME = 240.0  # s


@dataclass(frozen=True)
class Ride:
    """Where the vehicle was at every image (K, 2) m, and whether it said that the path is at its end."""

    places: Array
    has_finished: bool


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--homing-waypoints", type=int, default=12, help="waypoints whose basin is measured (12)")


def run(options: argparse.Namespace) -> Report:
    """Measure the basin, then drive."""
    site, plan = mcl_sites.town(options, SETTINGS, is_filled=False)
    report = Report("mcl_homing", notes=[describe(options.threads)])
    studio = mcl_sites.studio("town", options)
    count = 4 if options.quick else options.homing_waypoints
    errors = basin(site, studio, plan, count)
    rows = [
        (f"{radius:g}", str(len(e)), f"{np.mean(e <= GOOD_DEG):.0%}", f"{np.median(e):.0f}")
        for radius, e in errors.items()
    ]
    head = ("offset [m]", "images", f"direction within {GOOD_DEG:g} deg", "median error [deg]")
    report.tables.append(Table("Basin around a waypoint", head, rows))
    report.bounds.append(
        Bound(
            f"offset 1 m: direction within {GOOD_DEG:g} deg",
            80.0,
            100.0 * float(np.mean(errors[1.0] <= GOOD_DEG)),
            "%",
            True,
        )
    )
    starts = (0.0,) if options.quick else (0.0, 1.0, -1.0)
    rides = {left: drive(site, options.world_seed, left) for left in starts}
    report.bounds += [bound for left, ride in rides.items() for bound in ride_bounds(plan, left, ride)]
    return report


def basin(site: Site, studio: Studio, plan: Plan, count: int) -> dict[float, Array]:
    """Return the errors of the direction in deg by offset in m, one image each, no median."""
    path = taught_path(plan, "two_turns")
    rng = np.random.default_rng([studio.seed, 101])
    waypoints = path.at(np.linspace(5.0, path.length - 5.0, count))[:, :3]
    errors: dict[float, list[float]] = {radius: [] for radius in RADII}
    for number, waypoint in enumerate(waypoints):
        poses, radii = [], []
        for radius in RADII:
            for quarter in range(4):
                angle = (quarter + rng.random()) * np.pi / 2
                off = radius * np.array([np.cos(angle), np.sin(angle)])
                poses.append([*(waypoint[:2] + off), waypoint[2] + rng.uniform(-0.5, 0.5)])
                radii.append(radius)
        line = np.array(poses)
        shown = studio.record(line, 1000 + number)
        for index, radius in enumerate(radii):
            observation, truth = shown.observation(index), shown.truth(index)
            homing = Homing(_around(waypoint), DirectionParams(), start=1)  # its first answer: no median yet
            goal = homing.waypoints[1]
            found = homing.update(compare(site, observation.image, observation.rotation))
            true = np.arctan2(*(goal - truth[:2])[::-1])
            errors[radius].append(abs(float(np.degrees(wrap_angle(np.array(found.in_map - true))))))
    return {radius: np.array(values) for radius, values in errors.items()}


def _around(waypoint: Array) -> Array:
    """Return a path (3, 2) whose second waypoint is where the camera would be at a pose of the base."""
    ahead = np.array([np.cos(waypoint[2]), np.sin(waypoint[2])])
    middle = waypoint[:2] + PANORAMA.T_base_camera.translation[0] * ahead
    spacing = DirectionParams().spacing
    return np.stack([middle - spacing * ahead, middle, middle + spacing * ahead])


def compare(site: Site, image: NDArray[np.uint8], rotation: Array) -> Comparison:
    """Return the comparison of an image of the panorama with the map."""
    gray, is_seen = level_view(image, PANORAMA.camera, rotation, site.depth_map.camera)
    visual = visual_features(gray, is_seen)
    return Comparison(visual, site.depth_map, num_alpha_for(site.params.heading_step_deg))


def drive(site: Site, seed: int, left: float) -> Ride:
    """Drive the path of 100 m, starting `left` m beside it, steered by nothing but the direction to the waypoint."""
    camera = SimCameraParams(
        model="panorama", size=f"{PANORAMA.camera.width},{PANORAMA.camera.height}", period=PERIOD,
        mounting_deg=f"{float(PANORAMA.T_base_camera.translation[0])},0,{HEIGHT},0,0,0",
    )  # fmt: skip
    simulator = Simulator(SimParams(seed=seed, noise_seed=seed, camera=camera))
    x, y, yaw, _ = simulator.path.at(0.0)
    simulator.teleport(float(x - left * np.sin(yaw)), float(y + left * np.cos(yaw)), float(yaw))
    homing = Homing(sampled(simulator.path, 0.5)[:, :2], DirectionParams())
    places, command = [], VehicleCommand()
    while simulator.time_ns < MAX_TIME * SECOND and not homing.is_finished:
        if "camera" in simulator.take_due():
            found = homing.update(compare(site, simulator.capture("camera").image, np.eye(3)))
            command = VehicleCommand(SPEED, float(np.clip(GAIN * found.in_vehicle, -MAX_RATE, MAX_RATE)))
            places.append(simulator.T_world_base.translation[:2])
        simulator.step(command, SECOND // 100)
    return Ride(np.array(places), homing.is_finished)


def ride_bounds(plan: Plan, left: float, ride: Ride) -> list[Bound]:
    """Set what a ride gave beside what it should."""
    path = sampled(taught_path(plan, "two_turns"), 0.1)[:, :2]
    aside = np.array([np.min(np.linalg.norm(path - place, axis=1)) for place in ride.places])
    from_end = float(np.linalg.norm(ride.places[-1] - path[-1]))
    name = f"100 m by direction alone, start {left:+g} m beside"
    return [
        Bound(f"{name}: end reached within", 2.0, from_end if ride.has_finished else np.nan, "m"),
        Bound(f"{name}: largest distance from the path", 2.0, float(aside.max()), "m"),
        Bound(f"{name}: median distance", 0.5, float(np.median(aside)), "m"),
    ]
