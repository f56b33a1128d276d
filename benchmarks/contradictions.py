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

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from benchmarks import mcl_sites
from benchmarks.machine import describe
from benchmarks.mcl_drives import LENSES, Drive
from benchmarks.mcl_routes import kidnapped_line
from benchmarks.mcl_trials import NEAR_M, Trial, run_filter
from benchmarks.report import Bound, Report, Table
from mcl_depth.belief.motion_model import compose_planar, relative_motion
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.localization.status import Reason

HELP = "MCL with odometry that stands or slips, carried off: TRACKING beyond 1 m; and what healthy drives lose"
SEEDS = (71, 72)  # of the towns; parameters were chosen in 61 and 62
NUM_DRIVES = 20  # of each kind, all towns together
NUM_IMAGES, FAULT = 36, 12  # of a drive; the first image that a fault spoils
GRACE = 3  # images after that
STEPS = (0.15, 0.5, 1.0)  # between images, m
MAX_SLIP = 0.3  # of the way, more or less than there was
SKIPPED = 6  # images of the drive, over which the vehicle is carried along its own street
START_SIGMA = np.array([0.3, 0.3, np.radians(3.0)])  # of the start that is given, m, m, rad
MAX_LOSS, MAX_FALSE = 1.0, 0.1  # of the images of healthy drives: not TRACKING; said to contradict odometry, %

Fault = Callable[[Drive, Drive, float], Drive]  # of a drive, with another one, 0 to 1 by number


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--towns", type=_seeds, default=SEEDS, help=f"their seeds ({SEEDS[0]},{SEEDS[1]})")
    parser.add_argument("--lens", choices=LENSES, default="panorama", help="that takes the images (panorama)")
    parser.add_argument("--faults", help=f"some of {', '.join(FAULTS)}, with commas (all)")


def run(options: argparse.Namespace) -> Report:
    """Drive every drive in every way."""
    count = 4 if options.quick else options.starts or NUM_DRIVES
    towns = options.towns[:1] if options.quick else options.towns
    names = options.faults.split(",") if options.faults else list(FAULTS)
    if unknown := [name for name in names if name not in FAULTS]:
        raise ValueError(f"--faults: expected some of {', '.join(FAULTS)}, found {unknown[0]}")
    found: dict[str, list[Trial]] = {name: [] for name in names}
    for number, seed in enumerate(towns):
        share = len(range(number, count, len(towns)))
        for name, trials in _town(argparse.Namespace(**vars(options) | {"world_seed": seed}), share, names).items():
            found[name] += trials
    report = Report("contradictions", notes=[describe(options.threads), f"towns {', '.join(map(str, towns))}"])
    rows = [_row(name, trials) for name, trials in found.items()]
    head = (
        "fault",
        "drives",
        "TRACKING before",
        "TRACKING after",
        "of these wrong",
        "DEGRADED wrong",
        "pose right at end",
    )
    report.tables.append(
        Table(f"Images from {FAULT + GRACE} on, poses beyond {NEAR_M:g} m or 10 deg are wrong", head, rows)
    )
    report.bounds += [bound for name, trials in found.items() for bound in _bounds(name, trials)]
    return report


def _seeds(text: str) -> tuple[int, ...]:
    return tuple(int(word) for word in text.split(","))


def _town(options: argparse.Namespace, count: int, names: Sequence[str]) -> dict[str, list[Trial]]:
    """Return what the filter says of the drives of one town, by fault."""
    site, plan = mcl_sites.town(options)
    studio, lens = mcl_sites.studio("town", options), LENSES[options.lens]
    drives = []
    for number in range(count):
        rng = np.random.default_rng([studio.seed, number, 113])
        line = kidnapped_line(plan, NUM_IMAGES + SKIPPED, STEPS[number % len(STEPS)], rng)
        drives.append(studio.record(line, 900 + number, lens))
    found: dict[str, list[Trial]] = {name: [] for name in names}
    for number, drive in enumerate(tqdm(drives, f"town {options.world_seed}", leave=False, disable=None)):
        start = drive.truth(0) + START_SIGMA * np.random.default_rng([number, 127]).standard_normal(3)
        for name in names:
            spoiled = FAULTS[name](drive, drives[number - 1], number / max(count - 1, 1))
            found[name].append(run_filter(site, spoiled, site.params, number, start=(start, START_SIGMA)))
    return found


def healthy(drive: Drive, other: Drive, share: float) -> Drive:
    """Return the drive as it is."""
    return _cut(drive, np.arange(NUM_IMAGES), drive.odometry[:NUM_IMAGES])


def frozen(drive: Drive, other: Drive, share: float) -> Drive:
    """Return the drive with odometry that stands still while the car drives on."""
    rows = np.minimum(np.arange(NUM_IMAGES), FAULT - 1)
    return _cut(drive, np.arange(NUM_IMAGES), drive.odometry[rows])


def slipping(drive: Drive, other: Drive, share: float) -> Drive:
    """Return the drive with wheels whose way is up to 30 % longer (spinning) or shorter (locked) than that driven."""
    scale = 1.0 + MAX_SLIP * (2.0 * share - 1.0)
    return _cut(
        drive, np.arange(NUM_IMAGES), _rolled(drive.odometry[:NUM_IMAGES], lambda i: scale if i >= FAULT else 1.0)
    )


def carried_on(drive: Drive, other: Drive, share: float) -> Drive:
    """Return the drive with some of its way carried: the wheels stand, and roll again further along the street."""
    rows = np.concatenate([np.arange(FAULT), np.arange(FAULT + SKIPPED, NUM_IMAGES + SKIPPED)])
    return _cut(drive, rows, _spliced(drive.odometry, drive.odometry, rows))


def carried_off(drive: Drive, other: Drive, share: float) -> Drive:
    """Return a drive that goes on where another one does: lifted, and put down anywhere."""
    rows = np.arange(NUM_IMAGES)
    matrices = np.concatenate([drive.T_map_base.matrix[:FAULT], other.T_map_base.matrix[FAULT:NUM_IMAGES]])
    return replace(
        drive,
        images=np.concatenate([drive.images[:FAULT], other.images[FAULT:NUM_IMAGES]]),
        tilts=np.concatenate([drive.tilts[:FAULT], other.tilts[FAULT:NUM_IMAGES]]),
        T_map_base=SE3.from_matrix(matrices),
        odometry=_spliced(drive.odometry, other.odometry, rows),
    )


FAULTS: dict[str, Fault] = {
    "healthy": healthy,
    "frozen": frozen,
    "slipping": slipping,
    "carried on": carried_on,
    "carried off": carried_off,
}


def _cut(drive: Drive, rows: NDArray[np.integer], odometry: Array) -> Drive:
    """Return some images of a drive, with other odometry."""
    poses = SE3.from_matrix(drive.T_map_base.matrix[rows])
    return replace(drive, images=drive.images[rows], tilts=drive.tilts[rows], T_map_base=poses, odometry=odometry)


def _rolled(odometry: Array, scale: Callable[[int], float]) -> Array:
    """Return odometry whose way before each image is scaled."""
    poses = [odometry[0]]
    for index, (before, after) in enumerate(pairwise(odometry), 1):
        motion = relative_motion(before, after) * [scale(index), scale(index), 1.0]
        poses.append(compose_planar(poses[-1][None], motion)[0])
    return np.array(poses)


def _spliced(before: Array, after: Array, rows: NDArray[np.integer]) -> Array:
    """Return odometry that stands still at the fault, and then goes on by that of the rows of another drive."""
    poses = [*before[:FAULT], before[FAULT - 1]]
    for index in rows[FAULT + 1 :]:
        poses.append(compose_planar(poses[-1][None], relative_motion(after[index - 1], after[index]))[0])
    return np.array(poses)


def _later(trials: Sequence[Trial], what: Callable[[Trial], NDArray[np.bool_]]) -> int:
    return int(sum(what(trial)[FAULT + GRACE :].sum() for trial in trials))


def _row(name: str, trials: Sequence[Trial]) -> tuple[str, ...]:
    images = sum(len(trial.states) - FAULT - GRACE for trial in trials)
    before = np.mean([trial.is_tracking[FAULT - 1] & trial.is_right[FAULT - 1] for trial in trials])
    degraded = _later(trials, lambda trial: trial.is_trusted & ~trial.is_tracking & ~trial.is_right)
    return (
        name,
        str(len(trials)),
        f"{100.0 * before:.0f} %",
        f"{_later(trials, lambda trial: trial.is_tracking)} of {images}",
        str(_later(trials, lambda trial: trial.is_tracking & ~trial.is_right)),
        str(degraded),
        f"{100.0 * np.mean([trial.has_converged for trial in trials]):.0f} %",
    )


def _bounds(name: str, trials: Sequence[Trial]) -> list[Bound]:
    if name != "healthy":
        wrong = _later(trials, lambda trial: trial.is_tracking & ~trial.is_right)
        what = f"{name}, {len(trials)} drives: images TRACKING a wrong pose, later than {GRACE} images"
        return [Bound(what, 0.0, float(wrong), "")]
    begun = [trial for trial in trials if trial.is_tracking.any()]
    after = np.concatenate([trial.is_tracking[int(np.argmax(trial.is_tracking)) :] for trial in begun])
    reasons = [reason for trial in begun for reason in trial.reasons[int(np.argmax(trial.is_tracking)) :]]
    false = 100.0 * reasons.count(Reason.JUMP_REJECTED) / max(len(reasons), 1)
    what = f"healthy, {len(trials)} drives, {len(reasons)} images since TRACKING began"
    return [
        Bound(f"{what}: not TRACKING", MAX_LOSS, 100.0 * float(np.mean(~after)), "%"),
        Bound(f"{what}: said to contradict odometry", MAX_FALSE, false, "%"),
    ]
