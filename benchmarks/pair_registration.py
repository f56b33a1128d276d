"""Pairs of spheres of a town aligned from wrong first guesses: how many are accepted, and how many of these wrongly."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import describe
from benchmarks.report import Bound, Report, Table
from cycab_sim.params import LightParams, RenderParams
from cycab_sim.rendering.renderer import Renderer
from cycab_sim.world.worlds import build_world
from sphere_mapping.graph.both_ways import measure_motion
from sphere_mapping.graph.parts_motion import measure_motion_by_parts
from sphere_mapping.graph.registration import PreparedSphere
from sphere_mapping.params import MappingRegistrationParams
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.photometric import register
from sphere_nav.spheres.sphere import Sphere

HELP = "1,000 pairs of spheres from first guesses up to 5 m, 90 deg off: alignments accepted wrongly"
NUM_PAIRS = 1000
NUM_SPHERES, SPACING_M, MAX_STEPS = 60, 1.0, 3  # along the taught path; pairs are up to so many spheres apart
WIDTH, NOISE, HEIGHT_M = 256, 2.0, 1.6  # px, grey levels, m above the ground
MAX_OFF_M, MAX_OFF_DEG = 5.0, 90.0
WRONG_M, WRONG_DEG = 0.1, 1.0
PARAMS = MappingRegistrationParams()
WAYS = ("one way", "both ways", "by parts")


@dataclass(frozen=True)
class Found:
    """Errors (m, deg) of one way alone, of both ways, and of both by parts of the images; None where it was refused."""

    one_way: tuple[float, float] | None
    both_ways: tuple[float, float] | None
    by_parts: tuple[float, float] | None


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--pair-seeds", type=int, nargs="+", default=[21, 22], help="of towns and guesses (21 22)")
    parser.add_argument("--pairs", type=int, default=NUM_PAIRS, help="in all (1000)")


def run(options: argparse.Namespace) -> Report:
    """Measure on every seed."""
    count = (50 if options.quick else options.pairs) // len(options.pair_seeds)
    found: list[Found] = []
    rows: list[tuple[str, ...]] = []
    for seed in options.pair_seeds:
        pairs = measure_pairs(seed, count)
        found += pairs
        rows.append((str(seed), str(count), *_counts(pairs)))
    columns = ("seed", "pairs", *(f"{way}{told}" for way in WAYS for told in (" accepted", ", wrong")))
    report = Report("pair_registration", [Table("First guesses up to 5 m, 90 deg off", columns, rows)])
    report.notes.append(describe(options.threads))
    both, parts = ([one for one in way if one is not None] for way in _by_way(found)[1:])
    off = f"more than {WRONG_M} m or {WRONG_DEG:g} deg off, of {len(found)} pairs"
    report.bounds += [
        Bound(f"accepted {off}", 0.0, float(sum(map(is_wrong, both))), ""),
        Bound("pairs accepted", 25.0, 100.0 * len(both) / len(found), "%", True),
        Bound(f"accepted by parts of the images {off}", 0.0, float(sum(map(is_wrong, parts))), ""),
    ]
    return report


def measure_pairs(seed: int, count: int) -> list[Found]:
    """Align pairs of one town from random first guesses."""
    spheres, poses = render_drive(seed)
    rng = np.random.default_rng([seed, 5])
    found = []
    for _ in range(count):
        a = int(rng.integers(NUM_SPHERES - MAX_STEPS))
        b = a + int(rng.integers(1, MAX_STEPS + 1))
        truth = poses[a].inverse() @ poses[b]
        guess = truth @ random_motion(rng, MAX_OFF_M, np.radians(MAX_OFF_DEG))
        alone = register(spheres[b].pyramid, [spheres[a].at(SE3.identity())], guess, PARAMS)
        both = measure_motion(spheres[a], spheres[b], guess, PARAMS)
        parts = measure_motion_by_parts(spheres[a], spheres[b], guess, PARAMS)
        one_way = _error(truth, alone.T_world_camera) if alone.is_converged else None
        found.append(Found(one_way, *(_error(truth, one.T_a_b) if one is not None else None for one in (both, parts))))
    return found


def render_drive(seed: int) -> tuple[list[PreparedSphere], list[SE3]]:
    """Return spheres along the taught path of a town, and their poses."""
    world, camera = build_world("town", seed, "block"), Spherical(WIDTH, WIDTH // 2)
    renderer = Renderer(world.mesh, RenderParams(), LightParams(), num_threads=1)
    rng = np.random.default_rng([seed, 4])
    spheres, poses = [], []
    for number in range(NUM_SPHERES):
        x, y, yaw, _ = world.path.at(np.array(number * SPACING_M))
        pose = SE3.from_planar(float(x), float(y), float(yaw)) @ SE3.from_parts(np.eye(3), [0.0, 0.0, HEIGHT_M])
        levels, range_m = renderer.render(camera, pose, is_gray=True)
        image: NDArray[np.uint8] = np.clip(np.rint(levels + rng.normal(0, NOISE, levels.shape)), 1, 255).astype(
            np.uint8
        )
        spheres.append(PreparedSphere(Sphere(image, range_m.astype(np.float32), camera, number), PARAMS))
        poses.append(pose)
    return spheres, poses


def random_motion(rng: np.random.Generator, max_m: float, max_rad: float) -> SE3:
    """Return a motion in a random direction about a random axis, its size even up to the limits."""
    direction, axis = rng.normal(size=(2, 3))
    shift = direction / np.linalg.norm(direction) * rng.uniform(0, max_m)
    turn = axis / np.linalg.norm(axis) * rng.uniform(0, max_rad)
    return SE3.exp(np.concatenate([shift, turn]))


def is_wrong(error: tuple[float, float]) -> bool:
    """Say whether an accepted alignment is wrong."""
    return error[0] > WRONG_M or error[1] > WRONG_DEG


def _error(truth: SE3, found: SE3) -> tuple[float, float]:
    distance, angle = truth.distance(found)
    return float(distance), float(np.degrees(angle))


def _by_way(pairs: Sequence[Found]) -> list[list[tuple[float, float] | None]]:
    return [[pair.one_way for pair in pairs], [pair.both_ways for pair in pairs], [pair.by_parts for pair in pairs]]


def _counts(pairs: Sequence[Found]) -> list[str]:
    """Return of each way how many it accepted, and how many of them wrongly."""
    accepted = [[one for one in way if one is not None] for way in _by_way(pairs)]
    return [str(count) for way in accepted for count in (len(way), sum(map(is_wrong, way)))]
