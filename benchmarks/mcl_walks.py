"""Walks through neighbouring panoramas of a real home, located in its floor plan (geometry only)."""

from __future__ import annotations

import argparse
import csv
import time
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Report, Table
from mcl_depth.estimate import Look
from mcl_depth.filter import Filter
from mcl_depth.motion_model import between, moved
from mcl_depth.params import FilterParams
from mcl_depth.site import Site
from sphere_geometry import SE3, Spherical
from typed_params import build

HELP = "MCL through panoramas of a home: walks from every start, uniform particles, noisy odometry"
Array = NDArray[np.float64]
NEAR = 1.0  # m, an end this close to the truth counts as found
SETTINGS = {
    "cache.max_distance": 0.25,
    "area.step": 0.25,
    "area.clearance": 0.2,
    "camera_height": 1.435,
    "motion.min_sigma": 0.1,
    "motion.way_share": 0.06,
    "motion.side_share": 0.06,
    "motion.min_sigma_deg": 3.0,
    "motion.max_leap": 20.0,
    "input.max_leap_s": 1000.0,
    "resampling.is_adaptive": False,
    "recovery.is_active": False,
}


@dataclass(frozen=True)
class Place:
    """A panorama and where it was taken, x, y, yaw (3,)."""

    image: NDArray[np.uint8]
    pose: Array


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--home", type=Path, default=Path("../shared/data/panoramas_in_floor_plan"))
    parser.add_argument("--walk-seeds", type=int, default=3, help="seeds of every walk (3)")
    parser.add_argument("--walk-length", type=int, default=8, help="panoramas of a walk (8)")


def run(options: argparse.Namespace) -> Report:
    """Walk from every panorama."""
    from mcl_depth.geometry_files import read_geometry

    places, geometry = read_places(options.home), read_geometry(options.home / "surfaces.csv")
    seeds = 1 if options.quick else options.walk_seeds
    rows = []
    for name, changes, is_blind in (
        ("s / max(s), turned on the first two images", {}, False),
        ("min-max scaling", {"weight.scaling": "minmax"}, False),
        ("turned on every image", {"adjustment.later": 1.0}, False),
        ("control: without images", {}, True),
    ):
        site = Site(geometry, 0.0, build(FilterParams, SETTINGS | changes))
        started = time.perf_counter()
        errors = [walk(site, places, start, seed, options.walk_length, is_blind=is_blind)
                  for start in range(len(places)) for seed in range(1, seeds + 1)]  # fmt: skip
        metres = np.array([error[0] for error in errors])
        step_ms = 1e3 * (time.perf_counter() - started) / len(errors) / options.walk_length
        near = f"{np.mean(metres < NEAR):.1%}"
        turns = np.degrees([error[1] for error in errors])
        rows.append((name, len(errors), near, f"{np.median(metres):.2f}", f"{np.median(turns):.1f}", f"{step_ms:.0f}"))
    head = ("variant", "walks", "end within 1 m", "median error [m]", "median heading error [deg]", "ms an image")
    return Report("Walks in bare geometry", [Table("1000 particles, uniform start, odometry 5 %, 3 deg", head, rows)])


def read_places(folder: Path) -> list[Place]:
    """Read the panoramas; the pose of the sight follows from the plan's conventions.

    Its azimuth grows to the right, so the plan is a mirror image of the home: the pictures are mirrored, too.
    """
    places = []
    with (folder / "poses.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            image = cv2.imread(str(folder / "images" / row["image"]), cv2.IMREAD_GRAYSCALE)
            if image is None:
                raise ValueError(f"{folder / 'images' / row['image']}: expected a picture")
            yaw = np.radians(90.0 + float(row["rotation_deg"]))  # the centre column looks along the local y axis
            places.append(
                Place(np.ascontiguousarray(image[:, ::-1]), np.array([float(row["x_m"]), float(row["y_m"]), yaw]))
            )
    return places


def walk(
    site: Site, places: list[Place], start: int, seed: int, length: int, *, is_blind: bool = False
) -> tuple[float, float]:
    """Return the error at the end of a walk from panorama `start`: m and rad."""
    rng = np.random.default_rng([seed, start])
    filter_ = Filter(replace(site.params, seed=int(rng.integers(1 << 30))), site.depth_map, site.area)
    odometry, before = np.zeros(3), places[start].pose
    pose, true = odometry, before
    for index, number in enumerate(route(places, start, length)):
        true = places[number].pose
        motion = between(before, true)
        motion[:2] *= 1.0 + 0.05 * rng.standard_normal()
        motion[2] += np.radians(3.0) * rng.standard_normal() * (index > 0)
        odometry, before = moved(odometry[None], motion)[0], true
        image = places[number].image
        if is_blind:
            image = rng.integers(0, 255, image.shape).astype(np.uint8)
        look = Look(image, Spherical(1024, 512), (index + 1) * 10**9, np.eye(3), SE3.from_planar(*odometry))
        belief = filter_.update(look).belief
        assert belief is not None
        pose = belief.best.pose
    return float(np.hypot(*(pose - true)[:2])), abs(float((pose[2] - true[2] + np.pi) % (2 * np.pi) - np.pi))


def route(places: list[Place], start: int, length: int) -> list[int]:
    """Return a walk to the nearest panorama not visited yet, again and again."""
    xy = np.array([place.pose[:2] for place in places])
    visited = [start]
    while len(visited) < min(length, len(places)):
        away = np.linalg.norm(xy - xy[visited[-1]], axis=1)
        away[visited] = np.inf
        visited.append(int(np.argmin(away)))
    return visited
