"""Pairs of spheres of a town aligned from wrong first guesses: how many are accepted, and how many of these wrongly."""

from __future__ import annotations

import argparse

import numpy as np

from benchmarks.mapping.drawn import draw, pose_at, town
from benchmarks.report import Bound, Headline, Report, Table
from sphere_mapping.graph.both_ways import measure_motion
from sphere_mapping.graph.parts_motion import measure_motion_by_parts
from sphere_mapping.graph.registration import PreparedSphere
from sphere_mapping.params import MappingRegistrationParams
from sphere_nav.geometry import SE3
from sphere_nav.photometric import register

HELP = "1,000 pairs of spheres from first guesses up to 5 m, 90 deg off: alignments accepted wrongly"
NUM_PAIRS, QUICK_PAIRS = 1000, 50
NUM_SPHERES, SPACING_M, MAX_STEPS = 60, 1.0, 3  # along the taught path; pairs are up to so many spheres apart
WIDTH, MAX_OFF_M, MAX_OFF_RAD = 256, 5.0, np.radians(90.0)
WRONG_M, WRONG_DEG = 0.1, 1.0
PARAMS = MappingRegistrationParams()
WAYS = ("one way", "both ways", "by parts")
Error = tuple[float, float]  # m, deg


def run(options: argparse.Namespace) -> Report:
    """Measure in two towns."""
    count = (QUICK_PAIRS if options.size == "quick" else NUM_PAIRS) // 2
    found: list[dict[str, Error | None]] = []
    report, rows = Report("pair_registration"), []
    for seed in (options.seed, options.seed + 1):
        pairs = measure_pairs(seed, count)
        found += pairs
        rows.append((str(seed), *(str(n) for way in WAYS for n in _counts(pairs, way))))
    columns = ("town", *(f"{way}{told}" for way in WAYS for told in (" accepted", ", wrong")))
    report.tables.append(Table(f"{count} pairs a town, first guesses up to 5 m, 90 deg off", columns, rows))
    off, told = f"more than {WRONG_M} m or {WRONG_DEG:g} deg off, of {len(found)} pairs", Headline("map", "towns")
    accepted, wrong = _counts(found, "both ways")
    report.bounds += [
        Bound(f"accepted {off}", 0.0, wrong, "", headline=told),
        Bound("pairs accepted", 25.0, 100.0 * accepted / len(found), "%", True),
        Bound(f"accepted by parts of the images {off}", 0.0, _counts(found, "by parts")[1], ""),
    ]
    return report


def measure_pairs(seed: int, count: int) -> list[dict[str, Error | None]]:
    """Align pairs of one town from random first guesses; return the error of each way, None where it was refused."""
    world, renderer = town(seed)
    rng = np.random.default_rng([seed, 4])
    poses = [pose_at(world.path, number * SPACING_M) for number in range(NUM_SPHERES)]
    drawn = [draw(renderer, pose, WIDTH, number, rng, is_exact=True) for number, pose in enumerate(poses)]
    spheres = [PreparedSphere(sphere, PARAMS) for sphere in drawn]
    found = []
    for _ in range(count):
        a = int(rng.integers(NUM_SPHERES - MAX_STEPS))
        b = a + int(rng.integers(1, MAX_STEPS + 1))
        truth = poses[a].inverse() @ poses[b]
        guess = truth @ random_motion(rng, MAX_OFF_M, MAX_OFF_RAD)
        alone = register(spheres[b].pyramid, [spheres[a].at(SE3.identity())], guess, PARAMS)
        both = measure_motion(spheres[a], spheres[b], guess, PARAMS)
        parts = measure_motion_by_parts(spheres[a], spheres[b], guess, PARAMS)
        motions = (
            alone.T_world_camera if alone.is_converged else None,
            both.T_a_b if both is not None else None,
            parts.T_a_b if parts is not None else None,
        )
        errors = (_error(truth, T) if T is not None else None for T in motions)
        found.append(dict(zip(WAYS, errors, strict=True)))
    return found


def random_motion(rng: np.random.Generator, max_m: float, max_rad: float) -> SE3:
    """Return a motion in a random direction about a random axis, its size even up to the limits."""
    direction, axis = rng.normal(size=(2, 3))
    shift = direction / np.linalg.norm(direction) * rng.uniform(0, max_m)
    turn = axis / np.linalg.norm(axis) * rng.uniform(0, max_rad)
    return SE3.exp(np.concatenate([shift, turn]))


def _error(truth: SE3, found: SE3) -> Error:
    distance, angle = truth.distance(found)
    return float(distance), float(np.degrees(angle))


def _counts(pairs: list[dict[str, Error | None]], way: str) -> tuple[int, int]:
    """Return how many pairs a way accepted, and how many of them wrongly."""
    accepted = [error for pair in pairs if (error := pair[way]) is not None]
    return len(accepted), sum(m > WRONG_M or deg > WRONG_DEG for m, deg in accepted)
