"""Drives whose first image is already in motion, mapped from images alone; and how often a first motion is a false one.

A stereo pair in a street that bends all the way (`bend.py`), by the mapper, from the first pair, and after a gap.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice, pairwise

import cv2
import numpy as np

from benchmarks.drive.bend import PERIOD_NS, STEP_M, TURN_DEG, Bend
from benchmarks.report import Bound, Headline, Report, Table
from sphere_mapping.graph.both_ways import find_motion
from sphere_mapping.graph.registration import PreparedSphere
from sphere_mapping.mapper import Mapper
from sphere_mapping.params import REGISTRATION, MapperParams
from sphere_nav.geometry import SE3
from sphere_nav.spheres.sphere import Sphere

HELP = "drives from images alone whose first image is in motion, gaps; false first motions"
NUM_IMAGES, QUICK_IMAGES = 51, 8  # of a drive
NUM_STREETS, QUICK_STREETS = 3, 2
MIN_PLACED, MAX_DRIFT = 95.0, 0.8  # %
GAP = 4  # images that are missing in the middle of a drive
DISTURBED = f"{GAP} images missing"
MAX_LOST = 2  # images after such a disturbance
APART_M = 40.0  # along a bend of 22 m radius: by then it has turned by 104 degrees, and shares nothing
NUM_PLACES, QUICK_PLACES = 40, 3  # of each false pair, all with all
WRONG_SHARE = 0.1  # of the motion, or of a metre: an accepted pair of a street that is farther off is a false one
PARAMS = MapperParams()


@dataclass(frozen=True, eq=False)
class Street:
    """A bend, the spheres of a drive through it, and where they truly were."""

    spheres: list[Sphere]
    poses: list[SE3]

    @staticmethod
    def render(seed: int, side: int, number: int) -> Street:
        """Return the drive of so many images through the bend of a seed, to the left (1) or to the right (-1)."""
        bend = Bend(seed, side * TURN_DEG)
        poses = bend.poses(number)
        return Street(list(bend.spheres(poses)), poses)


@dataclass(frozen=True)
class Drive:
    """What the mapper made of a drive: share placed and error at the end over the way, both in %; spheres lost."""

    placed: float
    drift: float
    num_lost: int


def run(options: argparse.Namespace) -> Report:
    """Measure what is there."""
    report, is_quick = Report("first_motion", notes=[__doc__ or ""]), options.size == "quick"
    number, count = (QUICK_IMAGES, QUICK_STREETS) if is_quick else (NUM_IMAGES, NUM_STREETS)
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        streets = [Street.render(options.seed + index, (-1) ** index, number) for index in range(count)]
        measure_bends(streets, report, 2 if is_quick else 3)
        measure_pairs(streets, options.seed, report, QUICK_PLACES if is_quick else NUM_PLACES)
    finally:
        cv2.setNumThreads(before)
    return report


def map_drive(spheres: Sequence[Sphere], poses: Sequence[SE3]) -> Drive:
    """Map spheres."""
    mapper = Mapper(PARAMS)
    found = [mapper.add(sphere).T_map_sphere for sphere in spheres]
    last = max(index for index, pose in enumerate(found) if pose is not None)
    way = sum(float(a.distance(b)[0]) for a, b in pairwise(poses[: last + 1]))
    end = found[last]
    off = float((poses[0].inverse() @ poses[last]).distance(end)[0]) if end is not None and last else np.nan
    placed = sum(pose is not None for pose in found)
    return Drive(100.0 * placed / len(found), 100.0 * off / way if last else np.nan, len(found) - placed)


def variants(street: Street) -> Iterator[tuple[str, list[Sphere], list[SE3]]]:
    """Yield what is driven: as it is, twice as fast, and with a gap in the middle."""
    spheres, poses, middle = street.spheres, street.poses, len(street.spheres) // 2
    yield f"{STEP_M:g} m, {TURN_DEG:g} deg an image", spheres, poses
    half = [stamped(sphere, number) for number, sphere in enumerate(spheres[::2])]
    yield f"{2 * STEP_M:g} m, {2 * TURN_DEG:g} deg an image", half, poses[::2]
    after = middle + GAP
    yield DISTURBED, spheres[:middle] + spheres[after:], poses[:middle] + poses[after:]


def stamped(sphere: Sphere, number: int) -> Sphere:
    """Return a sphere as the image of that number."""
    return Sphere(sphere.image, sphere.range_m, sphere.camera, (number + 1) * PERIOD_NS, sphere.range_std_m)


def measure_bends(streets: Sequence[Street], report: Report, num_variants: int) -> None:
    """Map every street in so many ways."""
    rows, found = list[tuple[str, ...]](), dict[str, list[Drive]]()
    for number, street in enumerate(streets):
        for what, spheres, poses in islice(variants(street), num_variants):
            drive = map_drive(spheres, poses)
            found.setdefault(what, []).append(drive)
            rows.append((str(number), what, f"{drive.placed:.0f}", f"{drive.drift:.2f}"))
    columns = ("street", "drive", "placed %", "drift %")
    report.tables.append(Table("A stereo pair in a bend, images alone", columns, rows))
    of = Headline("map", f"stereo pair in {len(streets)} streets that bend, images alone")
    for what, drives in found.items():
        placed, worst = min(drive.placed for drive in drives), max(drive.drift for drive in drives)
        if what == DISTURBED:
            lost = max(drive.num_lost for drive in drives)
            report.bounds.append(Bound(f"bend, {what}: images lost, worst street", MAX_LOST, lost, ""))
        else:
            report.bounds.append(Bound(f"bend, {what}: images placed, worst street", MIN_PLACED, placed, "%", True))
        is_plain = what == next(iter(found))
        what = f"bend, {what}: error at the end over the way, worst street"
        report.bounds.append(Bound(what, MAX_DRIFT, worst, "%", headline=of if is_plain else None))


def measure_pairs(streets: Sequence[Street], seed: int, report: Report, number: int) -> None:
    """Count first motions that are proven between images that share nothing, and wrong ones among those that do."""
    prepared = [[PreparedSphere(sphere, REGISTRATION) for sphere in street.spheres] for street in streets]
    rng = np.random.default_rng(seed)
    false, num_strangers = count_strangers(prepared, number**2, rng)
    counts = count_neighbors(streets, prepared, number, rng)
    pairs = counts.pop("pairs")
    rows = [(name, str(count)) for name, count in counts.items()]
    title = f"First motions of {num_strangers} pairs that share nothing, and {pairs} that are 1 to 5 m apart"
    report.tables.append(Table(title, ("what", "pairs"), rows))
    of = Headline("robustness", f"{num_strangers + pairs} pairs of streets that bend")
    wrong = false + counts["proven, wrong"]
    report.bounds += [
        Bound("first motions proven, wrong or between strangers", 0, wrong, "", headline=of),
        Bound("pairs 1 to 5 m apart that are proven", 90.0, 100.0 * counts["proven"] / pairs, "%", True),
    ]


def count_strangers(
    prepared: Sequence[Sequence[PreparedSphere]], number: int, rng: np.random.Generator
) -> tuple[int, int]:
    """Return how many of so many pairs of images that share nothing are proven to, and how many pairs there are."""
    strangers = [
        (one, other)
        for a, spheres in enumerate(prepared)
        for b, others in enumerate(prepared)
        for i, one in enumerate(spheres)
        for j, other in enumerate(others)
        if a != b or j - i > APART_M / STEP_M
    ]
    chosen = [strangers[index] for index in rng.permutation(len(strangers))[:number].tolist()]
    return sum(find_motion(one, other, REGISTRATION) is not None for one, other in chosen), len(chosen)


def count_neighbors(
    streets: Sequence[Street], prepared: Sequence[Sequence[PreparedSphere]], number: int, rng: np.random.Generator
) -> dict[str, int]:
    """Return how many of so many pairs of each street are proven, and how many wrongly."""
    counts = dict.fromkeys(("pairs", "proven", "proven, wrong"), 0)
    for street, spheres in zip(streets, prepared, strict=True):
        for _ in range(number):
            i, step = int(rng.integers(len(spheres) - 6)), int(rng.integers(1, 6))
            truth = street.poses[i].inverse() @ street.poses[i + step]
            proven = find_motion(spheres[i], spheres[i + step], REGISTRATION)
            counts["pairs"] += 1
            if proven is not None:
                counts["proven"] += 1
                off_m = float(truth.distance(proven.T_a_b)[0])
                counts["proven, wrong"] += off_m > WRONG_SHARE * max(1.0, step * STEP_M)
    return counts
