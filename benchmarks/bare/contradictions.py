"""Odometry that stands still, wheels that slip, a vehicle that is carried off: no TRACKING may outlive the images.

Every drive is driven as it is, and again with each fault from image 12 on. Images are those of the drive; only odometry
is another, or the drive goes on elsewhere. What counts is the status TRACKING of a pose beyond 1 m or 10 deg later than
three images after the fault began, and what the same drive loses while nothing is wrong.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.bare.drives import NEAR_M, Drive, Trial, build_town, kidnapped_line, record, run_filter
from benchmarks.report import Bound, Headline, Report, Table
from mcl_depth.belief.motion_model import compose_planar, relative_motion
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.localization.status import Reason

COUNTS = {"quick": (3, 1), "full": (10, 2)}  # drives of each kind in a town, towns
NUM_IMAGES, FAULT = 36, 12  # of a drive; the first image that a fault spoils
STILL = np.zeros(3)  # of the wheels
GRACE = 3  # images after that
STEPS = (0.15, 0.5, 1.0)  # between images, m
MAX_SLIP = 0.3  # of the way, more or less than there was
START_SIGMA = np.array([0.3, 0.3, np.radians(3.0)])  # of the start that is given, m, m, rad
MAX_LOSS, MAX_FALSE = 1.0, 0.1  # of the images of healthy drives: not TRACKING; said to contradict odometry, %

Fault = Callable[[Drive, Drive, float], Drive]  # of a drive, with another one, 0 to 1 by number


def run(options: argparse.Namespace) -> Report:
    """Drive every drive in every way."""
    count, num_towns = COUNTS[options.size]
    found: dict[str, list[Trial]] = {name: [] for name in FAULTS}
    for seed in range(options.seed, options.seed + num_towns):
        _drive(seed, count, found)
    report, rows = Report("contradictions"), [_row(name, these) for name, these in found.items()]
    head = ("fault", "drives", "TRACKING before", "TRACKING after", "wrong", "DEGRADED wrong", "right at end")
    title = f"Images from {FAULT + GRACE} on, poses beyond {NEAR_M:g} m or 10 deg are wrong"
    report.tables.append(Table(title, head, rows))
    report.bounds += _bounds(found)
    return report


def _drive(town: int, count: int, found: dict[str, list[Trial]]) -> None:
    """Add what the filter says of the drives of one town, by fault."""
    site, plan = build_town(town)
    drives = []
    for number in range(count):
        rng = np.random.default_rng([town, number, 113])
        line = kidnapped_line(plan, NUM_IMAGES, STEPS[number % len(STEPS)], rng)
        drives.append(record(town, line, 900 + number))
    for number, drive in enumerate(drives):
        start = drive.truth(0) + START_SIGMA * np.random.default_rng([number, 127]).standard_normal(3)
        for name, spoil in FAULTS.items():
            spoiled = spoil(drive, drives[number - 1], number / max(count - 1, 1))
            found[name].append(run_filter(site, spoiled.steps(), number, start=(start, START_SIGMA)))


def slipping(drive: Drive, other: Drive, share: float) -> Drive:
    """Return the drive with wheels whose way is up to 30 % longer (spinning) or shorter (locked) than that driven."""
    scale = np.array([1.0 + MAX_SLIP * (2.0 * share - 1.0)] * 2 + [1.0])
    motions = [relative_motion(before, after) for before, after in pairwise(drive.odometry)]
    return replace(drive, odometry=_going_on(drive, [motion * scale for motion in motions[FAULT - 1 :]]))


def carried_off(drive: Drive, other: Drive, share: float) -> Drive:
    """Return a drive that goes on where another one does: lifted, and put down anywhere; the wheels miss the jump."""

    def spliced(name: Callable[[Drive], NDArray[Any]]) -> NDArray[Any]:
        return np.concatenate([name(drive)[:FAULT], name(other)[FAULT:]])

    motions = [STILL, *(relative_motion(*pair) for pair in pairwise(other.odometry[FAULT:]))]
    images, tilts = spliced(lambda one: one.images), spliced(lambda one: one.tilts)
    T_map_base = SE3.from_matrix(spliced(lambda one: one.T_map_base.matrix))
    return Drive(images, T_map_base, _going_on(drive, motions), tilts)


FAULTS: dict[str, Fault] = {
    "healthy": lambda drive, other, share: drive,
    "frozen": lambda drive, other, share: replace(drive, odometry=_going_on(drive, [STILL] * (NUM_IMAGES - FAULT))),
    "slipping": slipping,
    "carried off": carried_off,
}


def _going_on(drive: Drive, motions: Sequence[Array]) -> Array:
    """Return odometry that goes on by other motions from the fault on."""
    poses = [*drive.odometry[:FAULT]]
    for motion in motions:
        poses.append(compose_planar(poses[-1][None], motion)[0])
    return np.array(poses)


def _later(trials: Sequence[Trial], what: Callable[[Trial], NDArray[np.bool_]]) -> int:
    return int(sum(what(trial)[FAULT + GRACE :].sum() for trial in trials))


def _row(name: str, trials: Sequence[Trial]) -> tuple[str, ...]:
    images = sum(len(trial.states) - FAULT - GRACE for trial in trials)
    before = np.mean([trial.is_tracking[FAULT - 1] & trial.is_right[FAULT - 1] for trial in trials])
    degraded = _later(trials, lambda trial: trial.is_trusted & ~trial.is_tracking & ~trial.is_right)
    shares = before, np.mean([trial.has_converged for trial in trials])
    begun, ended = (f"{100.0 * share:.0f} %" for share in shares)
    tracked = f"{_later(trials, lambda trial: trial.is_tracking)} of {images}"
    wrong = _later(trials, lambda trial: trial.is_tracking & ~trial.is_right)
    return name, str(len(trials)), begun, tracked, str(wrong), str(degraded), ended


def _bounds(found: dict[str, list[Trial]]) -> list[Bound]:
    spoiled = [trial for name in FAULTS if name != "healthy" for trial in found[name]]
    wrong = _later(spoiled, lambda trial: trial.is_tracking & ~trial.is_right)
    begun = [(trial, int(np.argmax(trial.is_tracking))) for trial in found["healthy"] if trial.is_tracking.any()]
    reasons = [reason for trial, begin in begun for reason in trial.reasons[begin:]]
    lost = sum(int(np.sum(~trial.is_tracking[begin:])) for trial, begin in begun)
    false, count = reasons.count(Reason.JUMP_REJECTED), max(len(reasons), 1)
    what, told = f"{len(spoiled)} spoiled drives: images TRACKING a wrong pose", Headline("bare geometry", "towns")
    healthy = f"healthy, {len(found['healthy'])} drives, {len(reasons)} images since TRACKING began"
    return [
        Bound(f"{what}, later than {GRACE} images", 0.0, float(wrong), "", headline=told),
        Bound(f"{healthy}: not TRACKING", MAX_LOSS, 100.0 * lost / count, "%"),
        Bound(f"{healthy}: said to contradict odometry", MAX_FALSE, 100.0 * false / count, "%"),
    ]
