"""Drives whose first image is already in motion, mapped from images alone; and how often a first motion is a false one.

A stereo pair in a street that bends all the way (`bend.py`), by the mapper, from the first pair, after a gap, a cover
and a jump; the recorded straight drive from every tenth image, by the commands; first pairs of recorded RGB-D images,
by what `sphere_nav register` does. Seeds from 11 on were looked at for nothing but these figures.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.bend import PERIOD_NS, STEP_M, TURN_DEG, Bend
from benchmarks.end_to_end import STEADY, call, drift
from benchmarks.machine import describe
from benchmarks.report import Bound, Report, Table
from benchmarks.rgbd_data import colmap_poses, open_recording
from sphere_mapping.acquisition.partial.partial_sphere import sphere_from_rgbd
from sphere_mapping.graph.both_ways import find_motion
from sphere_mapping.graph.registration import PreparedSphere
from sphere_mapping.mapper import Mapper
from sphere_mapping.params import MapperParams
from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import read_tum
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, Sphere
from sphere_nav_tools.offline.pose_bags import read_poses
from sphere_nav_tools.offline.registering import register_spheres

HELP = "drives from images alone whose first image is in motion, gaps and covers; false first motions"
NUM_IMAGES, QUICK_IMAGES = 51, 16  # of a drive
FAST = 2.0  # times as far and as much from image to image: half the images
MIN_PLACED, MAX_DRIFT = 95.0, 0.8  # %
GAP, COVERED = 4, 3  # images that are missing in the middle of a drive; that show nothing
DISTURBED = (f"{GAP} images missing", f"{COVERED} images covered", "a jump of 3 m between two images")
MAX_LOST = 2  # images after such a disturbance
STARTS, NUM_KITTI = (0, 10, 20, 30, 40), 51  # images of the recorded drive
PAIR_GAPS, PAIR_STEP, FRAME_S = (5, 10), 5, 1.0 / 30.0  # frames of redkitchen
WRONG_M, WRONG_DEG = 0.05, 1.0  # of a first pair indoors: `frame_to_frame` calls it failed
APART_M = 40.0  # along a bend of 22 m radius: by then it has turned by 104 degrees, and shares nothing
NUM_PLACES, QUICK_PLACES = 40, 16  # of each false pair, all with all
COUNTED = ("pairs", "proven", "proven, wrong", "register", "register, wrong")
WRONG_SHARE = 0.1  # of the motion, or of a metre: an accepted pair of a street that is farther off is a false one
PARAMS = MapperParams()


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments; `--recordings` is that of end_to_end."""
    parser.add_argument("--bend-seeds", type=int, nargs="+", default=[11, 12, 13], help="of streets (11 12 13)")


def run(options: argparse.Namespace) -> Report:
    """Measure what is there."""
    report = Report("first_motion", notes=[describe(options.threads), __doc__ or ""])
    number, seeds = (QUICK_IMAGES, options.bend_seeds[:2]) if options.quick else (NUM_IMAGES, options.bend_seeds)
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        streets = [Street.render(seed, (-1) ** index, number) for index, seed in enumerate(seeds)]
        measure_bends(streets, report)
        measure_pairs(streets, report, QUICK_PLACES if options.quick else NUM_PLACES)
        kitti, kitchen = options.recordings / "driving" / "kitti_06", options.recordings / "rgbd" / "redkitchen"
        if kitti.is_dir():
            measure_starts(kitti, STARTS[3:] if options.quick else STARTS, report)
        if kitchen.is_dir():
            measure_kitchen(kitchen, PAIR_STEP * (6 if options.quick else 1), report)
    finally:
        cv2.setNumThreads(before)
    report.notes += [f"no folder {one}: not measured" for one in (kitti, kitchen) if not one.is_dir()]
    return report


@dataclass(frozen=True, eq=False)
class Street:
    """A bend, the spheres of a drive through it, and where they truly were."""

    bend: Bend
    spheres: list[Sphere]
    poses: list[SE3]

    @staticmethod
    def render(seed: int, side: int, number: int) -> Street:
        """Return the drive of so many images through the bend of a seed, to the left (1) or to the right (-1)."""
        bend = Bend(seed, side * TURN_DEG)
        poses = bend.poses(number)
        return Street(bend, list(bend.spheres(poses)), poses)


@dataclass(frozen=True)
class Drive:
    """What the mapper made of a drive: share placed and error at the end over the way, both in %; spheres lost."""

    placed: float
    drift: float
    num_lost: int


def map_drive(spheres: Sequence[Sphere], poses: Sequence[SE3]) -> Drive:
    """Map spheres; those that show nothing are not expected to be placed."""
    mapper = Mapper(PARAMS)
    found = [mapper.add(sphere).T_map_sphere for sphere in spheres]
    seen = [bool(sphere.measured.any()) for sphere in spheres]
    last = max(index for index, pose in enumerate(found) if pose is not None)
    way = sum(float(a.distance(b)[0]) for a, b in pairwise(poses[: last + 1]))
    end = found[last]
    off = float((poses[0].inverse() @ poses[last]).distance(end)[0]) if end is not None and last else np.nan
    placed = sum(pose is not None for pose, is_seen in zip(found, seen, strict=True) if is_seen)
    return Drive(100.0 * placed / sum(seen), 100.0 * off / way if last else np.nan, sum(seen) - placed)


def variants(street: Street) -> Iterator[tuple[str, list[Sphere], list[SE3]]]:
    """Yield what is driven: as it is, faster, and with a gap, a cover and a jump in the middle."""
    spheres, poses, middle = street.spheres, street.poses, len(street.spheres) // 2
    every = round(FAST)
    half = [stamped(sphere, number) for number, sphere in enumerate(spheres[::every])]
    yield f"{STEP_M:g} m, {TURN_DEG:g} deg an image", spheres, poses
    yield f"{FAST * STEP_M:g} m, {FAST * TURN_DEG:g} deg an image", half, poses[::every]
    after = middle + GAP
    yield DISTURBED[0], spheres[:middle] + spheres[after:], poses[:middle] + poses[after:]
    dark = [blank(sphere) for sphere in spheres[middle : middle + COVERED]]
    yield DISTURBED[1], [*spheres[:middle], *dark, *spheres[middle + len(dark) :]], poses
    cut = [stamped(sphere, middle + number) for number, sphere in enumerate(spheres[middle + 2 :])]
    yield DISTURBED[2], spheres[:middle] + cut, poses[:middle] + poses[middle + 2 :]


def stamped(sphere: Sphere, number: int) -> Sphere:
    """Return a sphere as the image of that number."""
    return Sphere(sphere.image, sphere.range_m, sphere.camera, (number + 1) * PERIOD_NS, sphere.range_std_m)


def blank(sphere: Sphere) -> Sphere:
    """Return what a covered pair gives: grey, no range."""
    nothing: NDArray[np.float32] = np.full_like(sphere.range_m, np.nan)
    return Sphere(np.full_like(sphere.image, 20), nothing, sphere.camera, sphere.stamp_ns, nothing.copy())


def measure_bends(streets: Sequence[Street], report: Report) -> None:
    """Map every street in every way."""
    rows, found = list[tuple[str, ...]](), dict[str, list[Drive]]()
    for street in streets:
        for what, spheres, poses in variants(street):
            drive = map_drive(spheres, poses)
            found.setdefault(what, []).append(drive)
            rows.append((str(street.bend.seed), what, f"{drive.placed:.0f}", f"{drive.drift:.2f}"))
    report.tables.append(Table("A stereo pair in a bend, images alone", ("seed", "drive", "placed %", "drift %"), rows))
    for what, drives in found.items():
        placed, worst = min(drive.placed for drive in drives), max(drive.drift for drive in drives)
        if what in DISTURBED:
            lost = max(drive.num_lost for drive in drives)
            report.bounds.append(Bound(f"bend, {what}: images lost, worst seed", MAX_LOST, lost, ""))
        else:
            report.bounds.append(Bound(f"bend, {what}: images placed, worst seed", MIN_PLACED, placed, "%", True))
        report.bounds.append(Bound(f"bend, {what}: error at the end over the way, worst seed", MAX_DRIFT, worst, "%"))


def measure_pairs(streets: Sequence[Street], report: Report, number: int) -> None:
    """Count first motions that are proven between images that share nothing, and wrong ones among those that do."""
    prepared = [[PreparedSphere(sphere, PARAMS.registration) for sphere in street.spheres] for street in streets]
    false, num_strangers = count_strangers(prepared, number**2)
    counts = count_neighbors(streets, prepared, number)
    rows = [
        (f"{num_strangers} pairs that share nothing: proven", str(false), f"{bound_rate(false, num_strangers):.2g}")
    ]
    for name in ("proven", "register"):
        wrong = counts[f"{name}, wrong"]
        rows.append((f"{counts['pairs']} pairs 1 to 5 m apart: {name}", str(counts[name]), ""))
        rows.append((f"of them wrong: {name}", str(wrong), f"{bound_rate(wrong, counts[name]):.2g}"))
    report.tables.append(Table("First motions that are false", ("what", "number", "rate, at most (95 %)"), rows))
    report.bounds += [
        Bound("first motions proven between images that share nothing", 0, false, ""),
        Bound("first motions proven, wrong", 0, counts["proven, wrong"], ""),
        Bound("register: pairs said to be converged, wrong", 0, counts["register, wrong"], ""),
        Bound("pairs 1 to 5 m apart that are proven", 90.0, 100.0 * counts["proven"] / counts["pairs"], "%", True),
    ]


def count_strangers(prepared: Sequence[Sequence[PreparedSphere]], number: int) -> tuple[int, int]:
    """Return how many of so many pairs of images that share nothing are proven to, and how many pairs there are."""
    strangers = [
        (one, other)
        for a, spheres in enumerate(prepared)
        for b, others in enumerate(prepared)
        for i, one in enumerate(spheres)
        for j, other in enumerate(others)
        if a != b or j - i > APART_M / STEP_M
    ]
    order = np.random.default_rng(7).permutation(len(strangers))[:number].tolist()
    chosen = [strangers[index] for index in order]
    return sum(find_motion(one, other, PARAMS.registration) is not None for one, other in chosen), len(chosen)


def count_neighbors(
    streets: Sequence[Street], prepared: Sequence[Sequence[PreparedSphere]], number: int
) -> dict[str, int]:
    """Return how many of so many pairs of each street are proven, and converged by `register`, and how many wrongly."""
    rng, counts = np.random.default_rng(8), dict.fromkeys(COUNTED, 0)
    for street, spheres in zip(streets, prepared, strict=True):
        for _ in range(number):
            i, step = int(rng.integers(len(spheres) - 6)), int(rng.integers(1, 6))
            truth = street.poses[i].inverse() @ street.poses[i + step]
            proven = find_motion(spheres[i], spheres[i + step], PARAMS.registration)
            told = register_spheres(street.spheres[i], street.spheres[i + step], SE3.identity(), PARAMS)
            answers = {"proven": proven.T_a_b} if proven is not None else {}
            if told["is_converged"]:
                answers["register"] = SE3(np.array(told["T_a_b"]["matrix"]))
            counts["pairs"] += 1
            for name, T_a_b in answers.items():
                counts[name] += 1
                counts[f"{name}, wrong"] += bool(truth.distance(T_a_b)[0] > WRONG_SHARE * max(1.0, step * STEP_M))
    return counts


def bound_rate(count: int, number: int) -> float:
    """Return the rate that would show at most so many cases in 5 % of all series: Poisson's, good for few of many."""
    limits = (3.0, 4.74, 6.3, 7.75, 9.15)  # quantiles of the mean for 0, 1, ... cases
    return limits[count] / max(number, 1) if count < len(limits) else (count + 2.0 * np.sqrt(count + 1.0)) / number


def measure_starts(data: Path, starts: Sequence[int], report: Report) -> None:
    """Map the recorded drive from several of its images on, by the commands."""
    rows = []
    for start in starts:
        with tempfile.TemporaryDirectory() as name:
            folder, number = Path(name), NUM_KITTI - start
            call("import", "kitti", data, "-o", folder / "bag", "--frames", f"{start}:{NUM_KITTI}")
            call("map", folder / "bag", "-o", folder / "map", "--trajectory", folder / "way.tum")
            travelled, truth = read_tum(folder / "way.tum"), read_poses(folder / "bag", ("ground_truth/pose",))
            placed, off = 100.0 * len(travelled) / number, drift(travelled, truth, 0)
            steady = drift(travelled, truth, STEADY) if start < STEADY < number else off
            rows.append((str(start), str(number), f"{placed:.0f}", f"{off:.2f}", f"{steady:.2f}"))
            report.bounds += [
                Bound(f"kitti_06 from image {start}: placed", MIN_PLACED, placed, "%", True),
                Bound(f"kitti_06 from image {start}: error at the end over the way", MAX_DRIFT, off, "%"),
            ]
    columns = ("first image", "images", "placed %", "drift %", f"drift % from image {STEADY} on")
    report.tables.append(Table("The recorded straight drive, images alone", columns, rows))


def measure_kitchen(data: Path, step: int, report: Report) -> None:
    """Register first pairs of recorded RGB-D images."""
    recording = open_recording(data, colmap_poses(data))
    calibration, rows = recording.calibrations[0], []
    for gap in PAIR_GAPS:
        off, num_refused = [], 0
        for paths in recording.pairs(gap, step):
            frames = [recording.frame(path, calibration) for path in paths]
            a, b = (
                sphere_from_rgbd(
                    one.gray, one.depth_m, calibration.camera, T_BODY_OPTICAL, round(1e9 * number * gap * FRAME_S)
                )
                for number, one in enumerate(frames)
            )
            told = register_spheres(a, b, SE3.identity(), PARAMS)
            T_a_b = T_BODY_OPTICAL @ frames[0].T_world_camera.inverse() @ frames[1].T_world_camera
            truth = T_a_b @ T_BODY_OPTICAL.inverse()
            num_refused += not told["is_converged"]
            if told["is_converged"]:
                off.append(truth.distance(SE3(np.array(told["T_a_b"]["matrix"]))))
        meters, radians = np.array(off).T
        wrong = int(np.sum((meters > WRONG_M) | (radians > np.radians(WRONG_DEG))))
        median = f"{1e3 * np.median(meters):.1f}"
        rows.append((str(gap), str(len(off) + num_refused), str(num_refused), str(wrong), median))
        report.bounds += [
            Bound(f"redkitchen, first pairs {gap} frames apart: refused", 0, num_refused, "pairs"),
            Bound(f"redkitchen, first pairs {gap} frames apart: converged, wrong", 0, wrong, "pairs"),
        ]
    columns = ("frames apart", "pairs", "refused", "wrong", "median mm")
    report.tables.append(Table("First pairs of redkitchen", columns, rows))
