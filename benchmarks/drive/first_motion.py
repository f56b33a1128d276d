"""Drives whose first image is already in motion, mapped from images alone; and how often a first motion is a false one.

A car sees by a stereo pair a street that bends all the way: by the mapper, from the first pair, and after a gap.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice, pairwise

import cv2
import numpy as np

from benchmarks.drive.street import build_road
from benchmarks.report import Bound, Headline, Report, Table
from cycab_sim.params import LightParams, RenderParams
from cycab_sim.rendering.renderer import Renderer
from cycab_sim.world.paths import Path, Piece
from sphere_mapping.acquisition.stereo.stereo import sphere_from_stereo
from sphere_mapping.graph.both_ways import find_motion
from sphere_mapping.graph.registration import PreparedSphere
from sphere_mapping.mapper import Mapper
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, Sphere

STEP_M, TURN_DEG, PERIOD_NS = 1.0, 2.6, 100_000_000  # of an image: 10 m/s, 26 degrees a second
CAMERA = Pinhole(1226, 370, 707.1, 707.1, 601.9, 183.1)  # as a car of KITTI carries
BASELINE_M, HEIGHT_M = 0.54, 1.65
SHAKE_RAD, NOISE = np.radians(0.25), 2.0  # standard deviations: of roll and pitch, from image to image; grey levels
BEGIN_M, BOUNDS = 10.0, (-110.0, -110.0, 110.0, 110.0)  # within the bend; of the ground, m
AROUND = 145.0  # degrees of the bend that are built
SIZES = {"quick": (2, 8, 2, 3), "full": (3, 51, 3, 40)}  # streets, images of a drive, ways to drive it, pairs of each
MIN_PLACED, MAX_DRIFT = 95.0, 0.8  # %
GAP = 4  # images that are missing in the middle of a drive
DISTURBED = f"{GAP} images missing"
MAX_LOST = 2  # images after such a disturbance
APART_M = 40.0  # along a bend of 22 m radius: by then it has turned by 104 degrees, and shares nothing
WRONG_SHARE = 0.1  # of the motion, or of a metre: an accepted pair of a street that is farther off is a false one


Street = tuple[list[Sphere], list[SE3]]  # spheres of a drive through a bend, and where they truly were, body axes


def drive_bend(seed: int, side: int, number: int) -> Street:
    """Return what so many images through the bend of a seed give, to the left (1) or right (-1), by the pair alone."""
    radians = np.radians(side * TURN_DEG) / STEP_M
    path = Path((0.0, 0.0, 0.0), (Piece(np.radians(AROUND) / abs(radians), radians),))
    renderer = Renderer(build_road(seed, path, BOUNDS), RenderParams(), LightParams(), bounds=BOUNDS)
    T_left_right = SE3.from_parts(np.eye(3), [BASELINE_M, 0.0, 0.0])
    (rng, noise), poses, spheres = (np.random.default_rng([seed, n]) for n in (2, 3)), list[SE3](), list[Sphere]()
    for index in range(number):
        x, y, yaw, _ = path.at(BEGIN_M + index * STEP_M).tolist()
        shake = SE3.exp([0.0, 0.0, 0.0, *rng.normal(0.0, SHAKE_RAD, 2), 0.0])
        poses.append(SE3.from_planar(x, y, yaw) @ SE3.from_parts(np.eye(3), [0.0, 0.0, HEIGHT_M]) @ shake)
        T_world_left, pair = poses[-1] @ T_BODY_OPTICAL, []
        for T_world_camera in (T_world_left, T_world_left @ T_left_right):
            gray = renderer.render(CAMERA, T_world_camera, is_gray=True)[0]
            pair.append(np.clip(np.rint(gray + noise.normal(0.0, NOISE, gray.shape)), 0, 255).astype(np.uint8))
        stamp, (left, right) = (index + 1) * PERIOD_NS, pair
        spheres.append(sphere_from_stereo(left, right, CAMERA, BASELINE_M, T_BODY_OPTICAL, stamp))
    return spheres, poses


def run(options: argparse.Namespace) -> Report:
    """Measure what is there."""
    report = Report("first_motion", notes=[__doc__ or ""])
    count, num_images, num_variants, num_pairs = SIZES[options.size]
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        streets = [drive_bend(options.seed + index, (-1) ** index, num_images) for index in range(count)]
        measure_bends(streets, report, num_variants)
        measure_pairs(streets, options.seed, report, num_pairs)
    finally:
        cv2.setNumThreads(before)
    return report


def map_drive(spheres: Sequence[Sphere], poses: Sequence[SE3]) -> tuple[float, float, int]:
    """Map spheres; return the share placed and the error at the end over the way, both in %, and how many are lost."""
    mapper = Mapper()
    found = [mapper.add(sphere).T_map_sphere for sphere in spheres]
    last = max(index for index, pose in enumerate(found) if pose is not None)
    way = sum(float(a.distance(b)[0]) for a, b in pairwise(poses[: last + 1]))
    end, placed = found[last], sum(pose is not None for pose in found)
    assert end is not None
    off = float((poses[0].inverse() @ poses[last]).distance(end)[0])
    return 100.0 * placed / len(found), 100.0 * off / way if last else np.nan, len(found) - placed


def variants(street: Street) -> Iterator[tuple[str, list[Sphere], list[SE3]]]:
    """Yield what is driven: as it is, twice as fast, and with a gap in the middle."""
    (spheres, poses), middle = street, len(street[0]) // 2
    yield f"{STEP_M:g} m, {TURN_DEG:g} deg an image", spheres, poses
    half = [replace(sphere, stamp_ns=(number + 1) * PERIOD_NS) for number, sphere in enumerate(spheres[::2])]
    yield f"{2 * STEP_M:g} m, {2 * TURN_DEG:g} deg an image", half, poses[::2]
    after = middle + GAP
    yield DISTURBED, spheres[:middle] + spheres[after:], poses[:middle] + poses[after:]


def measure_bends(streets: Sequence[Street], report: Report, num_variants: int) -> None:
    """Map every street in so many ways."""
    rows, found = list[tuple[str, ...]](), dict[str, list[tuple[float, float, int]]]()
    for number, street in enumerate(streets):
        for what, spheres, poses in islice(variants(street), num_variants):
            placed, drift, num_lost = map_drive(spheres, poses)
            found.setdefault(what, []).append((placed, drift, num_lost))
            rows.append((str(number), what, f"{placed:.0f}", f"{drift:.2f}"))
    columns = ("street", "drive", "placed %", "drift %")
    report.tables.append(Table("A stereo pair in a bend, images alone", columns, rows))
    told: Headline | None = Headline("map", f"stereo pair in {len(streets)} streets that bend, images alone")
    for what, drives in found.items():
        if what == DISTURBED:
            lost = max(num_lost for _, _, num_lost in drives)
            report.bounds.append(Bound(f"bend, {what}: images lost, worst street", MAX_LOST, lost, ""))
        else:
            least = min(placed for placed, _, _ in drives)
            report.bounds.append(Bound(f"bend, {what}: images placed, worst street", MIN_PLACED, least, "%", True))
        worst, told_of = max(drift for _, drift, _ in drives), f"bend, {what}: error at the end over the way"
        report.bounds.append(Bound(f"{told_of}, worst street", MAX_DRIFT, worst, "%", headline=told))
        told = None


def measure_pairs(streets: Sequence[Street], seed: int, report: Report, number: int) -> None:
    """Count first motions that are proven between images that share nothing, and wrong ones among those that do."""
    prepared = [[PreparedSphere(sphere) for sphere in spheres] for spheres, _ in streets]
    rng = np.random.default_rng(seed)
    strangers = [
        (one, other)
        for a, spheres in enumerate(prepared)
        for b, others in enumerate(prepared)
        for i, one in enumerate(spheres)
        for j, other in enumerate(others)
        if a != b or j - i > APART_M / STEP_M
    ]
    chosen = [strangers[index] for index in rng.permutation(len(strangers))[: number**2].tolist()]
    false = sum(find_motion(one, other) is not None for one, other in chosen)
    pairs, num_proven, num_wrong = number * len(streets), 0, 0
    for (_, poses), spheres in zip(streets, prepared, strict=True):
        for _ in range(number):
            i, step = int(rng.integers(len(spheres) - 6)), int(rng.integers(1, 6))
            proven = find_motion(spheres[i], spheres[i + step])
            if proven is not None:
                truth = poses[i].inverse() @ poses[i + step]
                num_proven += 1
                num_wrong += float(truth.distance(proven.T_a_b)[0]) > WRONG_SHARE * max(1.0, step * STEP_M)
    of = Headline("robustness", f"{len(chosen) + pairs} pairs of streets that bend")
    report.bounds += [
        Bound("first motions proven, wrong or between strangers", 0, false + num_wrong, "", headline=of),
        Bound("pairs 1 to 5 m apart that are proven", 90.0, 100.0 * num_proven / pairs, "%", True),
    ]
