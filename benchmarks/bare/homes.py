"""Homes searched from nowhere: walks through panoramas, in their plan and in that of another home; a real one, too.

Walks go from a panorama to the nearest one not visited yet, with odometry of 5 % and 3 degrees. The real home's truth
and plan are of its recording.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np

from benchmarks.bare.drives import NEAR_M, Step, Trial, run_filter
from benchmarks.bare.home_world import HEIGHT, Home, home
from benchmarks.report import Bound, Headline, Report, Table
from mcl_depth.belief.estimate import Observation
from mcl_depth.belief.motion_model import compose_planar, relative_motion
from mcl_depth.geometry.files import read_geometry
from mcl_depth.geometry.mesh import TriangleMesh
from mcl_depth.params import FilterParams
from mcl_depth.site import Site
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.files.encoded import read_image_file

WALK, PUBLISHED_BY = 8, 15  # panoramas after which the place is asked for, and until a pose is published
CLOSE, MAX_CPU_MS = 0.5, 100.0  # m off the truth; of an image while the place is searched
PACE = 2.0  # m/s
COUNTS = {"quick": (2, 2, 2), "full": (10, 16, 16)}  # homes, walks in each, walks in the real one
HEAD = ("map", "walks", "within 1 m", "within 0.5 m", "published", "wrong poses", "CPU ms")


def run(options: argparse.Namespace) -> Report:
    """Walk in each home, in its own plan and in that of the next one."""
    num_homes, num_walks, num_real = COUNTS[options.size]
    rows, right, wrong = [], list[Trial](), list[Trial]()
    for number in range(num_homes):
        here, other = home(options.seed + number), home(options.seed + (number + 1) % num_homes)
        for seen, found, what in ((here, right, "its own plan"), (other, wrong, "the plan of another")):
            walks = walk(here.plan, seen, num_walks, options.seed + number)
            rows.append((f"home {options.seed + number}, {what}", *_figures(walks)))
            found += walks
    report = Report("homes", notes=[__doc__ or ""])
    report.bounds += _bounds(f"{num_homes} homes, {len(right)} walks", right)
    claimed = sum(bool(one.is_trusted.any()) for one in wrong)
    report.bounds.append(Bound(f"{len(wrong)} walks in another's plan: ever a pose", 0.0, claimed, ""))
    folder = options.data / "panoramas_in_floor_plan"
    if folder.is_dir():
        real = read_home(folder)
        walks = walk(real.plan, real, num_real, options.seed)
        rows.append(("a real home", *_figures(walks)))
        report.bounds += _bounds(f"a real home, {len(walks)} walks", walks)
    report.tables.append(Table(f"after {WALK} panoramas; published by {PUBLISHED_BY}", HEAD, rows))
    return report


def walk(plan: TriangleMesh, seen: Home, count: int, seed: int) -> list[Trial]:
    """Walk from so many panoramas; images of another home are wrong wherever they are claimed to be."""
    site, found = Site(plan, HEIGHT, FilterParams()), []
    for number in range(count):
        again, start = divmod(number, len(seen.poses))  # the second walk from a panorama is another one
        found.append(run_filter(site, steps(seen, start, seed + 1000 * again), seed + 1000 * again))
    return found


def read_home(folder: Path) -> Home:
    """Read the panoramas; the pose of the level camera follows from the plan's conventions.

    Its azimuth grows to the right, so the plan is a mirror image of the home: the pictures are mirrored, too.
    """
    images, poses = [], []
    with (folder / "poses.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            image = read_image_file(folder / "images" / row["image"], cv2.IMREAD_GRAYSCALE)
            yaw = np.radians(90.0 + float(row["rotation_deg"]))  # the centre column looks along the local y axis
            poses.append((float(row["x_m"]), float(row["y_m"]), yaw))
            images.append(np.ascontiguousarray(image[:, ::-1]))
    plan = read_geometry(folder / "surfaces.csv")
    assert isinstance(plan, TriangleMesh)
    return Home(plan, np.stack(images), np.array(poses))


def steps(seen: Home, start: int, seed: int) -> Iterator[Step]:
    """Yield what a filter takes on a walk from panorama `start`, and the true pose (3,)."""
    rng, camera = np.random.default_rng([seed, start]), Spherical(*seen.images.shape[:0:-1])
    odometry, before, seconds = np.zeros(3), seen.poses[start], 1.0
    for index, number in enumerate(_route(seen.poses[:, :2], start)):
        true = seen.poses[number]
        motion = relative_motion(before, true)
        motion[:2] *= 1.0 + 0.05 * rng.standard_normal()
        seconds += max(float(np.hypot(motion[0], motion[1])) / PACE, 0.5)
        motion[2] += np.radians(3.0) * rng.standard_normal() * (index > 0)
        odometry, before = compose_planar(odometry[None], motion)[0], true
        yield Observation(seen.images[number], camera, int(seconds * 1e9), np.eye(3), SE3.from_planar(*odometry)), true


def _route(xy: Array, start: int) -> list[int]:
    """Return a walk to the nearest panorama not visited yet, again and again."""
    visited = [start]
    while len(visited) < min(PUBLISHED_BY, len(xy)):
        away = np.linalg.norm(xy - xy[visited[-1]], axis=1)
        away[visited] = np.inf
        visited.append(int(np.argmin(away)))
    return visited


def _counts(found: Sequence[Trial]) -> tuple[float, float, float, int, float]:
    """Return shares near, close and published, the number of wrong poses, and the CPU of an image while searching."""
    errors = np.array([walk.meters[WALK - 1] for walk in found])
    published = float(np.mean([walk.is_trusted.any() for walk in found]))
    wrong = sum(int(np.sum(walk.is_trusted & (walk.meters > NEAR_M))) for walk in found)
    ms = float(np.median([np.median(walk.cpu_ms[~walk.is_trusted]) for walk in found]))
    return float(np.mean(errors < NEAR_M)), float(np.mean(errors < CLOSE)), published, wrong, ms


def _bounds(what: str, found: Sequence[Trial]) -> list[Bound]:
    near, _, published, wrong, ms = _counts(found)
    told = Headline("bare geometry", "panoramas in a plan")
    return [
        Bound(f"{what}: within {NEAR_M:g} m after {WALK}", 90.0, 100.0 * near, "%", is_minimum=True),
        Bound(f"{what}: a pose by panorama {PUBLISHED_BY}", 90.0, 100.0 * published, "%", True, told),
        Bound(f"{what}: wrong poses", 0.0, wrong, ""),
        Bound(f"{what}: CPU of an image, searching", MAX_CPU_MS, ms, "ms"),
    ]


def _figures(found: Sequence[Trial]) -> tuple[str, ...]:
    *shares, wrong, ms = _counts(found)
    return (str(len(found)), *(f"{share:.0%}" for share in shares), str(wrong), f"{ms:.0f}")
