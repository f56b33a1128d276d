"""Homes searched from nowhere: walks through panoramas, in their plan and in that of another home; a real one, too.

Walks go from a panorama to the nearest one not visited yet, with odometry of 5 % and 3 degrees. The real home's truth
and plan are of its recording.
"""

from __future__ import annotations

import argparse
import csv
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.bare.home_world import HEIGHT, PANORAMA, home
from benchmarks.report import Bound, Headline, Report, Table
from mcl_depth.belief.estimate import Observation
from mcl_depth.belief.motion_model import compose_planar, relative_motion
from mcl_depth.filter import Filter
from mcl_depth.geometry.files import read_geometry
from mcl_depth.params import FilterParams
from mcl_depth.site import Site
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.geometry.arrays import Array

HELP = "homes drawn from a seed, with furniture, and a real one: walks from nowhere"
WALK, PUBLISHED_BY = 8, 15  # panoramas after which the place is asked for, and until a pose is published
NEAR, CLOSE, MAX_CPU_MS = 1.0, 0.5, 100.0  # m off the truth; of an image while the place is searched
PACE = 2.0  # m/s
COUNTS = {"quick": (2, 2, 2), "full": (10, 16, 16)}  # homes, walks in each, walks in the real one
HEAD = ("map", "walks", "within 1 m", "within 0.5 m", "published", "wrong poses", "CPU ms")


@dataclass(frozen=True)
class Place:
    """A panorama and where it was taken, x, y, yaw (3,)."""

    image: NDArray[np.uint8]
    pose: Array


@dataclass(frozen=True)
class Outcome:
    """Of one walk: error m of the likeliest place at panorama `WALK`, poses that left, and how many were wrong."""

    error: float
    is_published: bool
    num_wrong: int
    search_ms: float  # CPU of an image while searching, median


def run(options: argparse.Namespace) -> Report:
    """Walk in each home, in its own plan and in that of the next one."""
    num_homes, num_walks, num_real = COUNTS[options.size]
    params = FilterParams()
    rows, right, wrong = [], list[Outcome](), list[Outcome]()
    for number in range(num_homes):
        here, other = home(options.seed + number), home(options.seed + (number + 1) % num_homes)
        site = Site(here.plan, HEIGHT, params)
        for images, found, what in ((here, right, "its own plan"), (other, wrong, "the plan of another")):
            places = [Place(*one) for one in zip(images.images, images.poses, strict=True)]
            walks = [walk(site, places, PANORAMA, n, options.seed + number) for n in range(num_walks)]
            rows.append((f"home {options.seed + number}, {what}", *_figures(walks)))
            found += walks
    report = Report("homes", notes=[__doc__ or ""])
    report.bounds += _bounds(f"{num_homes} homes, {len(right)} walks", right)
    report.bounds.append(
        Bound(f"{len(wrong)} walks in another's plan: ever a pose", 0.0, sum(one.is_published for one in wrong), "")
    )
    folder = options.data / "panoramas_in_floor_plan"
    if folder.is_dir():
        site, places = Site(read_geometry(folder / "surfaces.csv"), HEIGHT, params), read_places(folder)
        walks = [walk(site, places, Spherical(1024, 512), n, options.seed) for n in range(num_real)]
        rows.append(("a real home", *_figures(walks)))
        report.bounds += _bounds(f"a real home, {len(walks)} walks", walks)
    report.tables.append(Table(f"after {WALK} panoramas; published by {PUBLISHED_BY}", HEAD, rows))
    return report


def walk(site: Site, places: Sequence[Place], camera: Spherical, start: int, seed: int) -> Outcome:
    """Walk from a panorama; images of another home are wrong wherever they are claimed to be."""
    seed += 1000 * (start // len(places))  # the second walk from a panorama is another one
    one = Filter(replace(site.params, seed=seed), site.depth_map, site.area)
    error, wrong, out, times = np.nan, 0, 0, []
    for index, (observation, true) in enumerate(steps(places, camera, start % len(places), seed)):
        begin = time.process_time()
        estimate = one.update(observation)
        elapsed = 1e3 * (time.process_time() - begin)
        if estimate.T_map_level is not None:
            out += 1
            wrong += float(np.hypot(*(estimate.T_map_level.translation[:2] - true[:2]))) > NEAR
        else:
            times.append(elapsed)
        if index == WALK - 1 and estimate.belief is not None:
            error = float(np.hypot(*(estimate.belief.places[0].pose - true)[:2]))
    return Outcome(error, out > 0, wrong, float(np.median(times)))


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
            pose = np.array([float(row["x_m"]), float(row["y_m"]), yaw])
            places.append(Place(np.ascontiguousarray(image[:, ::-1]), pose))
    return places


def steps(places: Sequence[Place], camera: Spherical, start: int, seed: int) -> Iterator[tuple[Observation, Array]]:
    """Yield what a filter takes on a walk from panorama `start`, and the true pose (3,)."""
    rng = np.random.default_rng([seed, start])
    odometry, before, seconds = np.zeros(3), places[start].pose, 1.0
    for index, number in enumerate(_route(places, start)):
        true = places[number].pose
        motion = relative_motion(before, true)
        motion[:2] *= 1.0 + 0.05 * rng.standard_normal()
        seconds += max(float(np.hypot(motion[0], motion[1])) / PACE, 0.5)
        motion[2] += np.radians(3.0) * rng.standard_normal() * (index > 0)
        odometry, before = compose_planar(odometry[None], motion)[0], true
        image = places[number].image
        yield Observation(image, camera, int(seconds * 1e9), np.eye(3), SE3.from_planar(*odometry)), true


def _route(places: Sequence[Place], start: int) -> list[int]:
    """Return a walk to the nearest panorama not visited yet, again and again."""
    xy, visited = np.array([place.pose[:2] for place in places]), [start]
    while len(visited) < min(PUBLISHED_BY, len(places)):
        away = np.linalg.norm(xy - xy[visited[-1]], axis=1)
        away[visited] = np.inf
        visited.append(int(np.argmin(away)))
    return visited


def _bounds(what: str, found: Sequence[Outcome]) -> list[Bound]:
    near = 100.0 * float(np.mean([item.error < NEAR for item in found]))
    published = 100.0 * float(np.mean([item.is_published for item in found]))
    told = Headline("bare geometry", "panoramas in a plan")
    return [
        Bound(f"{what}: within {NEAR:g} m after {WALK}", 90.0, near, "%", is_minimum=True),
        Bound(f"{what}: a pose by panorama {PUBLISHED_BY}", 90.0, published, "%", True, told),
        Bound(f"{what}: wrong poses", 0.0, sum(item.num_wrong for item in found), ""),
        Bound(f"{what}: CPU of an image, searching", MAX_CPU_MS, float(np.median([o.search_ms for o in found])), "ms"),
    ]


def _figures(found: Sequence[Outcome]) -> tuple[str, ...]:
    errors = np.array([item.error for item in found])
    shares = np.mean(errors < NEAR), np.mean(errors < CLOSE), np.mean([item.is_published for item in found])
    ms = np.median([item.search_ms for item in found])
    return (str(len(found)), *(f"{s:.0%}" for s in shares), str(sum(item.num_wrong for item in found)), f"{ms:.0f}")
