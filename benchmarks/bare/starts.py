"""Placed from nowhere in bare geometry: a town by day, by night, by other cameras, a loop, a corridor, ramps.

In the town a drive begins anywhere in 100 x 100 m; parked cars and traffic are in the images, not in the cloud. The
corridor of 160 m has equal bays (N17 section V): a place is named when it is proven. Ramps of 8 % are driven with an
IMU, and without one as a control.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.bare import trials
from benchmarks.bare.drives import LENSES, LIGHTS, NIGHT, Drive, Studio, kidnapped, sampled
from benchmarks.bare.trials import Trial, run_filter, site
from benchmarks.report import Bound, Headline, Report, Table
from cycab_sim.params import LightParams
from cycab_sim.world.town import taught_path
from cycab_sim.world.worlds import CORRIDOR
from mcl_depth.geometry.area import Area
from mcl_depth.site import Site
from sphere_nav.geometry.arrays import Array

HELP = "places from nowhere: town by day, night and other cameras, a loop of 500 images, corridor, ramps"
PRIOR, LAST, CORRIDOR_STEP = 40.0, 156.0, 2.0  # m: where a drive may begin, where it ends, between images
RAMPS, EDGE, RAMP_END = ((20.0, 60.0), (80.0, 120.0)), 2.0, 128.0  # m; around the kinks that belongs to neither
OFFSETS = (0.0, 0.35, -0.35, 0.6, -0.8)  # of drives from the middle of corridor and street, m
HEAD = ("case", "starts", "found %", "wrong", "error m", "deg", "found by image", "first image ms", "TRACKING ms")


@dataclass(frozen=True)
class Case:
    """Starts in the town: camera, lights, images of a drive, starts quick and full, share that is to be found in %."""

    camera: str
    lights: tuple[LightParams, ...]
    num_images: int
    counts: tuple[int, int]
    least: float


CASES = {
    "town": Case("panorama", LIGHTS, 20, (8, 100), 95.0),
    "town by night": Case("panorama", (NIGHT,), 20, (0, 24), 95.0),
    "pinhole of 100 deg": Case("pinhole_100", LIGHTS[:1], 40, (4, 15), 80.0),
    "fisheye of 190 deg": Case("fisheye_190", LIGHTS[:1], 40, (0, 15), 80.0),
    "fisheye to the sky": Case("fisheye_190_up", LIGHTS[:1], 40, (0, 15), 80.0),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    trials.add_arguments(parser)


def run(options: argparse.Namespace) -> Report:
    """Start everywhere, then drive round the block, along the corridor and over the ramps."""
    report, rows, is_quick = Report("starts", notes=[__doc__ or ""]), list[tuple[str, ...]](), options.size == "quick"
    here, plan = trials.town(options.seed, options.likeness)
    studio = Studio("town", options.seed)
    for name, case in CASES.items():
        if count := case.counts[not is_quick]:
            drives = kidnapped(studio, plan, count, case.num_images, LENSES[case.camera], case.lights)
            found = [run_filter(here, drive, seed) for seed, drive in enumerate(drives)]
            rows.append((name, *_figures(found)))
            report.bounds += _start_bounds(name, found, case.least)
    path, number = taught_path(plan, "block"), 60 if is_quick else 500
    step = path.length * max(round(0.3 * number / path.length), 1) / number if number >= 2 * path.length else 0.3
    report.bounds += _loop_bounds(run_filter(here, studio.record(sampled(path, step, number), 500), 1))
    count = 1 if is_quick else 6
    corridor = site("corridor", options.seed, options.likeness, {"area.limits": f"0.3,-2.5,{CORRIDOR - 0.3:.1f},2.5"})
    near = Area(corridor.area.middles[corridor.area.middles[:, 0] < PRIOR], corridor.area.step)
    drives = _corridor_drives(options.seed, count)
    found = [run_filter(corridor, drive, seed, start_area=near) for seed, drive in enumerate(drives)]
    rows.append(("corridor", *_figures(found)))
    report.bounds += _start_bounds("corridor", found, 90.0)
    street = site("ramp", options.seed, options.likeness, {"area.limits": "-18,-18,146,18"})
    _ramps(street, _ramp_drives(options.seed, 1 if is_quick else 4), report)
    report.tables.append(Table("Starts", HEAD, rows))
    return report


def _start_bounds(name: str, found: Sequence[Trial], least: float) -> list[Bound]:
    share, wrong = 100.0 * np.mean([one.has_converged for one in found]), sum(one.num_false > 0 for one in found)
    told = Headline("bare geometry", "towns of the simulator, 100 m") if name == "town" else None
    what = f"{name}, {len(found)} starts"
    return [
        Bound(f"{what}: right and TRACKING at the last image", least, float(share), "%", True, told),
        Bound(f"{what}: TRACKING anywhere at a wrong place", 0.0, wrong, ""),
    ]


def _figures(found: Sequence[Trial]) -> tuple[str, ...]:
    good = [one for one in found if one.has_converged]
    middle = [np.median(ends) for ends in np.array([(one.meters[-1], one.degrees[-1]) for one in good]).T]
    first = f"{np.median([one.first for one in good]):.0f}" if good else "-"
    steady = np.concatenate([one.milliseconds[one.is_tracking] for one in found])
    return (
        str(len(found)),
        f"{100 * len(good) / len(found):.0f}",
        str(sum(one.num_false > 0 for one in found)),
        *([f"{value:.2f}" for value in middle] or ("-", "-")),
        first,
        f"{np.median([one.milliseconds[0] for one in found]):.0f}",
        f"{np.median(steady):.0f}" if len(steady) else "-",
    )


def _loop_bounds(trial: Trial) -> list[Bound]:
    """Set what the loop gave beside what it should."""
    name = f"loop of {len(trial.states)} images"
    if not trial.is_tracking.any():
        return [Bound(f"{name}: TRACKING begins with image", 20, np.nan, "")]
    begin = int(np.argmax(trial.is_tracking))
    return [
        Bound(f"{name}: TRACKING begins with image", 20, begin + 1, ""),
        Bound(f"{name}: largest error after that", 1.0, float(trial.meters[begin:].max()), "m"),
        Bound(f"{name}: median error", 0.3, float(np.median(trial.meters[begin:])), "m"),
        Bound(f"{name}: images without a pose", 0.0, float(np.sum(~trial.is_trusted[begin:])), ""),
    ]


def _corridor_drives(seed: int, count: int) -> list[Drive]:
    """Return drives from the first bay to the far end: what is ahead of the truth meets the end wall first."""
    studio, drives = Studio("corridor", seed), []
    for number in range(count):
        x = np.arange(np.random.default_rng([seed, number, 89]).uniform(1.5, 7.5), LAST, CORRIDOR_STEP)
        drives.append(studio.record(_straight(x, OFFSETS[number % len(OFFSETS)]), number))
    return drives


def _straight(x: Array, offset: float) -> Array:
    """Return poses (N, 3) at x (N,), beside the middle, headed as x goes."""
    return np.column_stack([x, np.full(len(x), offset), np.full(len(x), np.pi * (x[0] > x[-1]))])


def _ramp_drives(seed: int, count: int) -> list[Drive]:
    """Return drives over the ramps, every other one back."""
    studio, x = Studio("ramp", seed), np.arange(0.0, RAMP_END)
    return [studio.record(_straight(x[:: 1 - 2 * (n % 2)], OFFSETS[-1 - n % 3]), n) for n in range(count)]


def _ramps(street: Site, drives: Sequence[Drive], report: Report) -> None:
    """Add the errors on ramps beside those on flat ground, with the IMU and without."""
    rows = []
    for name, has_imu in (("IMU", True), ("no IMU", False)):
        found = [run_filter(street, drive, seed, has_imu=has_imu) for seed, drive in enumerate(drives)]
        flat, ramp = _by_ground(drives, found)
        cells = (f"{np.median(part):.2f}" if len(part) else "-" for part in (flat, ramp))
        rows.append((name, str(len(flat) + len(ramp)), *cells, str(sum(one.num_false for one in found))))
        if has_imu:
            ratio = float(np.median(ramp) / np.median(flat)) if len(flat) and len(ramp) else np.nan
            report.bounds += [
                Bound("ramps of 8 %: median error by that on flat ground", 1.5, ratio, ""),
                Bound("ramps of 8 %: images TRACKING at a wrong place", 0.0, sum(one.num_false for one in found), ""),
            ]
    report.tables.append(Table("Ramps", ("variant", "images with a pose", "flat m", "ramp m", "wrong"), rows))


def _by_ground(drives: Sequence[Drive], found: Sequence[Trial]) -> tuple[Array, Array]:
    """Return the errors in m of all images with a pose after the first TRACKING, on flat ground and on the ramps."""
    flat, ramp = [np.zeros(0)], [np.zeros(0)]
    for drive, trial in zip(drives, found, strict=True):
        x = np.array([drive.truth(index)[0] for index in range(len(drive))])
        begin = np.argmax(trial.is_tracking) if trial.is_tracking.any() else len(drive)
        is_used = trial.is_trusted & (np.arange(len(drive)) >= begin)
        is_up = np.any([(x > low + EDGE) & (x < high - EDGE) for low, high in RAMPS], axis=0)
        is_level = np.all([(x < low - EDGE) | (x > high + EDGE) for low, high in RAMPS], axis=0)
        ramp.append(trial.meters[is_used & is_up])
        flat.append(trial.meters[is_used & is_level])
    return np.concatenate(flat), np.concatenate(ramp)
