"""Walks through neighbouring panoramas of a real home, located in its floor plan (geometry only)."""

from __future__ import annotations

import argparse
import csv
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import describe
from benchmarks.mcl_trials import remembering
from benchmarks.report import Bound, Report, Table
from mcl_depth.belief.estimate import Observation
from mcl_depth.belief.motion_model import compose_planar, relative_motion
from mcl_depth.filter import Filter
from mcl_depth.geometry.files import read_geometry
from mcl_depth.params import FilterParams
from mcl_depth.site import Site
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.geometry.arrays import Array

HELP = "MCL through panoramas of a home: walks from every start, uniform particles, noisy odometry"
NEAR, CLOSE = 1.0, 0.5  # m, an end this close to the truth counts as found, or as close
HEIGHT = 1.435  # of the camera, m
PACE = 2.0  # m/s


@dataclass(frozen=True)
class Place:
    """A panorama and where it was taken, x, y, yaw (3,)."""

    image: NDArray[np.uint8]
    pose: Array


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments; the folder is that of `--panoramas`."""
    parser.add_argument("--halves", action="store_true", help="walk in each half of the panoramas by itself")
    parser.add_argument("--walk-seeds", type=int, default=5, help="seeds of every walk (5)")
    parser.add_argument("--first-walk-seed", type=int, default=11, help="the first of them (11)")
    parser.add_argument("--walk-length", type=int, default=8, help="panoramas of a walk (8)")


def run(options: argparse.Namespace) -> Report:
    """Walk from every panorama."""
    report = Report("mcl_walks", notes=[describe(options.threads)])
    if not options.panoramas.is_dir():
        report.skipped = f"no folder {options.panoramas}"
        return report
    places, geometry = read_places(options.panoramas), read_geometry(options.panoramas / "surfaces.csv")
    site = remembering(Site(geometry, HEIGHT, FilterParams()))
    seeds = range(options.first_walk_seed, options.first_walk_seed + (2 if options.quick else options.walk_seeds))
    parts = {"all": places} if not options.halves else {"even": places[::2], "odd": places[1::2]}
    rows, found = [], []
    for name, part in parts.items():
        errors = _errors(site, part, seeds, options.walk_length)
        found.append(errors)
        rows.append((name, *_figures(errors)))
    rows.append(
        ("control: without images", *_figures(_errors(site, places, seeds, options.walk_length, is_blind=True)))
    )
    near = 100.0 * np.concatenate([np.mean(errors[..., 0] < NEAR, axis=1) for errors in found])
    close = 100.0 * float(np.mean(np.concatenate([errors[..., 0].ravel() for errors in found]) < CLOSE))
    report.bounds += [
        Bound(f"end within {NEAR:g} m, mean", 90.0, float(near.mean()), "%", is_minimum=True),
        Bound(f"end within {NEAR:g} m, worst seed and half", 80.0, float(near.min()), "%", is_minimum=True),
        Bound(f"end within {CLOSE:g} m", 75.0, close, "%", is_minimum=True),
    ]
    head = ("panoramas", "walks", "end within 1 m", "worst seed", "best seed", "median error [m]", "heading [deg]")
    report.tables.append(Table("1000 particles, uniform start, odometry 5 %, 3 deg", head, rows))
    return report


def _errors(site: Site, places: list[Place], seeds: range, length: int, *, is_blind: bool = False) -> Array:
    """Return the errors (seeds, starts, 2) at the ends of walks from every place, m and rad."""
    return np.array(
        [[walk(site, places, start, seed, length, is_blind=is_blind) for start in range(len(places))] for seed in seeds]
    )


def _figures(errors: Array) -> tuple[str, ...]:
    by_seed = np.mean(errors[..., 0] < NEAR, axis=1)
    medians = np.median(errors[..., 0]), np.degrees(np.median(errors[..., 1]))
    shares = by_seed.mean(), by_seed.min(), by_seed.max()
    return str(errors[..., 0].size), *(f"{share:.0%}" for share in shares), f"{medians[0]:.2f}", f"{medians[1]:.1f}"


def read_places(folder: Path) -> list[Place]:
    """Read the panoramas; the pose of the level camera follows from the plan's conventions.

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
    pose = true = places[start].pose
    for observation, true in steps(places, Spherical(1024, 512), start, seed, length, is_blind=is_blind):  # noqa: B007
        belief = filter_.update(observation).belief
        assert belief is not None
        pose = belief.best.pose
    return float(np.hypot(*(pose - true)[:2])), abs(float((pose[2] - true[2] + np.pi) % (2 * np.pi) - np.pi))


def steps(
    places: list[Place], camera: Spherical, start: int, seed: int, length: int, *, is_blind: bool = False
) -> Iterator[tuple[Observation, Array]]:
    """Yield what a filter takes on a walk from panorama `start`, and the true pose (3,)."""
    rng = np.random.default_rng([seed, start])
    rng.integers(1 << 30)  # that of the filter
    odometry, before, seconds = np.zeros(3), places[start].pose, 1.0
    for index, number in enumerate(route(places, start, length)):
        true = places[number].pose
        motion = relative_motion(before, true)
        motion[:2] *= 1.0 + 0.05 * rng.standard_normal()
        seconds += max(float(np.hypot(motion[0], motion[1])) / PACE, 0.5)
        motion[2] += np.radians(3.0) * rng.standard_normal() * (index > 0)
        odometry, before = compose_planar(odometry[None], motion)[0], true
        image = places[number].image
        if is_blind:
            image = np.random.default_rng([number, 7]).integers(0, 255, image.shape).astype(np.uint8)
        yield Observation(image, camera, int(seconds * 1e9), np.eye(3), SE3.from_planar(*odometry)), true


def route(places: list[Place], start: int, length: int) -> list[int]:
    """Return a walk to the nearest panorama not visited yet, again and again."""
    xy = np.array([place.pose[:2] for place in places])
    visited = [start]
    while len(visited) < min(length, len(places)):
        away = np.linalg.norm(xy - xy[visited[-1]], axis=1)
        away[visited] = np.inf
        visited.append(int(np.argmin(away)))
    return visited
