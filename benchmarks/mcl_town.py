"""The town of 100 x 100 m as a bare cloud: kidnapped starts, and a loop of 500 images (DESIGN 7)."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchmarks import mcl_sites
from benchmarks.machine import describe
from benchmarks.mcl_drives import LIGHTS, PANORAMA, SHADOWLESS, Drive, Lens, Studio
from benchmarks.mcl_routes import kidnapped_line, sampled
from benchmarks.mcl_trials import NEAR_DEG, NEAR_M, Trial, run_filter
from benchmarks.report import Bound, Report, Table
from cycab_sim.params import LightParams
from cycab_sim.world.town import Plan, draw_plan, taught_path

HELP = "MCL in a town of 100 x 100 m without colour: kidnapped starts, a loop of 500 images"
NUM_IMAGES = 20
NUM_STARTS = 100
STEP = 1.0  # between the images of a kidnapped start, m


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    mcl_sites.add_arguments(parser)
    parser.add_argument("--loop-images", type=int, default=500, help="images of the loop (500)")


def run(options: argparse.Namespace) -> Report:
    """Start everywhere, then drive round the block."""
    num_starts, num_loop = (20, 100) if options.quick else (options.starts or NUM_STARTS, options.loop_images)
    plan, studio = draw_plan(options.world_seed), mcl_sites.studio("town", options)
    drives = kidnapped(studio, plan, num_starts, lights=mcl_sites.lights_of(options))
    report = Report("mcl_town", notes=[describe(options.threads)])
    line = sampled(taught_path(plan, "block"), loop_step(plan, num_loop), num_loop)
    loop = studio.record(line, 500, light=mcl_sites.lights_of(options)[0]) if num_loop else None
    for kind in mcl_sites.kinds_of(options):
        site, _ = mcl_sites.town(mcl_sites.of_kind(options, kind))
        trials = [run_filter(site, drive, site.params, seed) for seed, drive in enumerate(drives)]
        of = ("" if kind == "gradients" else f"{kind}: ") + ("by night: " if options.night else "")
        report.tables.append(_by_light(trials, kind, mcl_sites.lights_of(options)))
        bounds = start_bounds(trials)
        bounds += loop_bounds(run_filter(site, loop, site.params, 1)) if loop is not None else []
        report.bounds += [replace(bound, what=f"{of}{bound.what}") for bound in bounds]
    report.notes.append(_note(site.area.middles, site.area.step))
    return report


def kidnapped(
    studio: Studio,
    plan: Plan,
    count: int,
    *,
    lens: Lens = PANORAMA,
    num_images: int = NUM_IMAGES,
    step: float = STEP,
    lights: Sequence[LightParams] = LIGHTS,
) -> list[Drive]:
    """Return drives from anywhere, each with one of the lights; images are `step` m apart."""
    drives = []
    for number in range(count):
        rng = np.random.default_rng([studio.seed, number, 83])
        line = kidnapped_line(plan, num_images, step, rng)
        drives.append((number, line, lights[number % len(lights)]))
    ordered = sorted(drives, key=lambda item: item[0] % len(lights))  # one light after the other: shadows are cast once
    made = {number: studio.record(line, number, lens, light) for number, line, light in ordered}
    return [made[number] for number in range(count)]


def loop_step(plan: Plan, count: int) -> float:
    """Return the distance of images, at most 0.5 m, with which `count` of them go round whole times."""
    length = taught_path(plan, "block").length
    return length * max(round(0.3 * count / length), 1) / count if count >= length / 0.5 else 0.3


def start_bounds(trials: Sequence[Trial]) -> list[Bound]:
    """Set what kidnapped starts gave beside what they should."""
    converged = [trial for trial in trials if trial.has_converged]
    meters = [trial.meters[-1] for trial in converged]
    degrees = [trial.degrees[-1] for trial in converged]
    false = sum(trial.num_false > 0 for trial in trials)
    first = [trial.first for trial in converged]
    steady = np.concatenate([trial.milliseconds[trial.is_tracking] for trial in trials])
    return [
        Bound(
            "TRACKING at the right place at image 20, of all starts",
            95.0,
            100.0 * len(converged) / len(trials),
            "%",
            True,
        ),
        Bound("median error there", 0.3, float(np.median(meters)) if meters else np.nan, "m"),
        Bound("median error of the heading", 3.0, float(np.median(degrees)) if degrees else np.nan, "deg"),
        Bound(f"starts with TRACKING anywhere beyond {NEAR_M:g} m or {NEAR_DEG:g} deg", 0.0, float(false), ""),
        Bound(
            "median image of the first right TRACKING that lasts",
            20.0,
            float(np.median(first)) if first else np.nan,
            "",
        ),
        Bound("first image, all over the map, depth features there, median", 2000.0, first_image_ms(trials), "ms"),
        Bound("an image in TRACKING, median", 100.0, float(np.median(steady)) if len(steady) else np.nan, "ms"),
    ]


def first_image_ms(trials: Sequence[Trial]) -> float:
    """Return the median time of the first image."""
    return float(np.median([trial.milliseconds[0] for trial in trials]))


def loop_bounds(trial: Trial) -> list[Bound]:
    """Set what the loop gave beside what it should."""
    begin = int(np.argmax(trial.is_tracking)) if trial.is_tracking.any() else len(trial.states)
    after = slice(begin, None)
    meters, degrees = trial.meters[after], trial.degrees[after]
    name = f"loop of {len(trial.states)} images"
    if not len(meters):
        return [Bound(f"{name}: TRACKING begins", NUM_IMAGES, np.nan, "")]
    return [
        Bound(f"{name}: TRACKING begins with image", NUM_IMAGES, begin + 1, ""),
        Bound("largest error after that", NEAR_M, float(meters.max()), "m"),
        Bound("median error", 0.3, float(np.median(meters)), "m"),
        Bound("median error of the heading on the loop", 3.0, float(np.median(degrees)), "deg"),
        Bound("images without a pose", 0.0, float(np.sum(~trial.is_trusted[after])), ""),
        Bound("images TRACKING at a wrong place", 0.0, float(trial.num_false), ""),
    ]


def _by_light(trials: Sequence[Trial], kind: str, lights: Sequence[LightParams]) -> Table:
    rows: list[tuple[str, ...]] = []
    for index, light in enumerate(lights):
        part = trials[index :: len(lights)]
        share = 100.0 * np.mean([trial.has_converged for trial in part])
        sun = f"sun {light.sun} deg" if light != SHADOWLESS else "no shadows"
        rows.append((f"{sun}, exposure {light.exposure:g}", str(len(part)), f"{share:.0f} %"))
    return Table(f"Kidnapped starts by light, {kind}", ("light", "starts", "found"), rows)


def _note(middles: np.ndarray, step: float) -> str:
    return f"{len(middles) * step**2:.0f} m2 where the vehicle may be; parked cars are in the images, not in the cloud"
