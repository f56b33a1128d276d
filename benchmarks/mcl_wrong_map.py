"""Is a place claimed where none can be right? Images of one town in the cloud of another, or from beside the map.

The map is 100 x 100 m of a town, or, with `--side`, a square of a few metres of it for each start: around the middle of
the drive where the images are of the same town, elsewhere in it with `--off-map`.
"""

from __future__ import annotations

import argparse
import copy
from collections.abc import Sequence

import numpy as np
from tqdm import tqdm

from benchmarks import mcl_sites
from benchmarks.machine import describe
from benchmarks.mcl_drives import LENSES, LIGHTS, Drive, Lens, Studio
from benchmarks.mcl_routes import kidnapped_line, limits
from benchmarks.mcl_town import NUM_IMAGES, STEP, kidnapped
from benchmarks.mcl_trials import NEAR_DEG, NEAR_M, Trial, run_filter
from benchmarks.report import Bound, Report, Table
from cycab_sim.world.town import Plan, draw_plan
from mcl_depth.geometry.area import Area
from mcl_depth.site import Site

HELP = "MCL in the cloud of another town, and off the map: nothing may be claimed"
NUM_STARTS = 24
MAX_CLAIMS = 0.5  # of the starts, %
FOUND = 95.0  # of the starts in the right map, %
NUM_PART_IMAGES = 40  # of a drive with a camera that sees a part of the sphere
AWAY = 2.0  # from the map, of a drive that is not in it, m
SMALL_STEP = 0.5  # between the images of a drive in a small map, m
KEPT = 0.5  # of the town that is the map, where the images are from the other part
RIGHT, WRONG, OFF = "right map", "wrong map", "off the map"
HEAD = (
    "pair",
    "starts",
    "images",
    "ever TRACKING",
    "wrongly",
    "smallest p_chance, median",
    "smallest of all",
    "ms, median",
)


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument(
        "--map-seed", type=_seeds, default=(11,), help="seed of the town whose cloud is the map, or a,b,c (11)"
    )
    parser.add_argument(
        "--images-seed",
        type=_seeds,
        default=(12,),
        help="seed of the town of the images, for each map; the same: right",
    )
    parser.add_argument("--camera", choices=LENSES, default="panorama", help="that takes the images (panorama)")
    parser.add_argument("--side", type=float, help="of the square that is the map, m; else 100 m of the town")
    parser.add_argument("--mirrored", action="store_true", help="drives as a mirror shows them: no place is right")
    parser.add_argument("--off-map", action="store_true", help="half of the town is the map, images of the other half")


def run(options: argparse.Namespace) -> Report:
    """Start everywhere in each pair of map and images; count what is claimed."""
    pairs = _pairs(options.map_seed, options.images_seed)
    num_starts = 6 if options.quick else options.starts or NUM_STARTS
    if options.likeness == "both":
        raise ValueError("--likeness: expected gradients or learned, found both")
    report, rows = Report("mcl_wrong_map", notes=[describe(options.threads)]), []
    found: dict[str, list[list[Trial]]] = {RIGHT: [], WRONG: [], OFF: []}
    for map_seed, images_seed in tqdm(pairs, "pairs of towns", leave=False, disable=None):
        trials = _trials(options, map_seed, images_seed, num_starts)
        is_right = map_seed == images_seed and not options.mirrored
        found[OFF if options.off_map else RIGHT if is_right else WRONG].append(trials)
        rows.append((_note(map_seed, images_seed, options), *_figures(trials)))
    for name, groups in found.items():
        if groups:
            trials = [trial for group in groups for trial in group]
            of = "mirrored, " if options.mirrored else ""
            of += "by night, " if options.night else ""
            of += f"{options.likeness}, " if options.likeness != "gradients" else ""
            what = f"{of}{name}, {len(trials)} starts in {len(groups)} town{'s' if len(groups) > 1 else ''}"
            what += "" if options.camera == "panorama" else f", {options.camera}"
            what += f", maps of {options.side:g} m" if options.side else ""
            report.bounds += _right_bounds(what, trials) if name == RIGHT else _wrong_bounds(what, trials)
    report.tables.append(Table("What was claimed", HEAD, rows))
    return report


def _seeds(text: str) -> tuple[int, ...]:
    return tuple(int(word) for word in text.split(","))


def _pairs(maps: Sequence[int], images: Sequence[int]) -> list[tuple[int, int]]:
    if len(maps) != len(images):
        raise ValueError(f"--images-seed: expected {len(maps)} seeds, one for each map, found {len(images)}")
    return list(zip(maps, images, strict=True))


def _trials(options: argparse.Namespace, map_seed: int, images_seed: int, count: int) -> list[Trial]:
    """Return what the filter says of `count` drives through one town in the map of another, or of the same."""
    plan, changes = draw_plan(map_seed), {}
    x0, y0, x1, y1 = limits(plan)
    edge = x0 + KEPT * (x1 - x0) if options.off_map and not options.side else None
    if edge is not None:
        changes = {"area.limits": f"{x0:.2f},{y0:.2f},{edge:.2f},{y1:.2f}"}
    map_options = argparse.Namespace(**vars(options) | {"world_seed": map_seed})
    settings = mcl_sites.town_settings(plan, changes)
    site = mcl_sites.site("town", map_options, settings, is_filled=not options.side)
    drives = _drives(options, images_seed, count, edge)
    drives = [drive.mirrored for drive in drives] if options.mirrored else drives
    sites = [site] * count
    if options.side:
        is_right = map_seed == images_seed and not options.off_map
        sites = _squares(site, options.side, drives, plan, is_right=is_right)
    return [run_filter(sites[seed], drive, site.params, seed) for seed, drive in enumerate(drives)]


def _drives(options: argparse.Namespace, images_seed: int, count: int, edge: float | None) -> list[Drive]:
    """Return drives from anywhere in the town of the images, or beyond x = `edge`."""
    image_options = argparse.Namespace(**vars(options) | {"world_seed": images_seed})
    studio, plan, lens = mcl_sites.studio("town", image_options), draw_plan(images_seed), LENSES[options.camera]
    num_images = NUM_IMAGES if options.camera == "panorama" or options.side else NUM_PART_IMAGES
    if edge is not None:
        return _beside(studio, plan, edge, count, lens, num_images)
    step = SMALL_STEP if options.side else STEP
    lights = mcl_sites.lights_of(options)
    return kidnapped(studio, plan, count, lens=lens, num_images=num_images, step=step, lights=lights)


def _squares(site: Site, side: float, drives: Sequence[Drive], plan: Plan, *, is_right: bool) -> list[Site]:
    """Return for each drive the site of a square of the map: around its middle, or one that it keeps away from."""
    rng = np.random.default_rng([len(drives), 59])
    parts = []
    for drive in drives:
        way = np.array([drive.truth(index)[:2] for index in range(len(drive))])
        middle = way[len(way) // 2]
        while not is_right and np.abs(way - middle).max(axis=1).min() < 0.5 * side + AWAY:
            middle = kidnapped_line(plan, 1, STEP, rng)[0, :2]
        part, middles = copy.copy(site), site.area.middles  # depth images are shared
        part.area = Area(middles[np.abs(middles - middle).max(axis=1) <= 0.5 * side], site.area.step)
        parts.append(part)
    return parts


def _beside(studio: Studio, plan: Plan, edge: float, count: int, lens: Lens, num_images: int) -> list[Drive]:
    """Return drives all of whose poses are beyond x = `edge`, by more than what a place may be off."""
    rng = np.random.default_rng([studio.seed, 7])
    lines: list[np.ndarray] = []
    while len(lines) < count:
        line = kidnapped_line(plan, num_images, STEP, rng)
        if np.all(line[:, 0] > edge + AWAY):
            lines.append(line)
    share = -(-count // len(LIGHTS))  # one light after the other: shadows are cast once
    return [studio.record(line, 500 + n, lens, LIGHTS[n // share]) for n, line in enumerate(lines)]


def _right_bounds(what: str, trials: Sequence[Trial]) -> list[Bound]:
    found = 100.0 * float(np.mean([trial.has_converged for trial in trials]))
    false = float(sum(trial.num_false > 0 for trial in trials))
    return [
        Bound(f"{what}: TRACKING at the right place at image {len(trials[0].states)}", FOUND, found, "%", True),
        Bound(f"{what}: starts with TRACKING beyond {NEAR_M:g} m or {NEAR_DEG:g} deg", 0.0, false, ""),
    ]


def _wrong_bounds(what: str, trials: Sequence[Trial]) -> list[Bound]:
    claimed = 100.0 * float(np.mean([trial.is_tracking.any() for trial in trials]))
    return [Bound(f"{what}: TRACKING anywhere", MAX_CLAIMS, claimed, "%")]


def _figures(trials: Sequence[Trial]) -> tuple[str, ...]:
    smallest = [float(trial.p_chance.min()) for trial in trials]
    return (
        str(len(trials)),
        str(sum(len(trial.states) for trial in trials)),
        str(sum(trial.is_tracking.any() for trial in trials)),
        str(sum(trial.num_false > 0 for trial in trials)),
        f"{np.median(smallest):.1e}",
        f"{min(smallest):.1e}",
        f"{np.median(np.concatenate([trial.milliseconds for trial in trials])):.0f}",
    )


def _note(map_seed: int, images_seed: int, options: argparse.Namespace) -> str:
    images = f"images of town {images_seed}" if map_seed != images_seed else "its own images"
    if options.side:
        part = f"squares of {options.side:g} m; {images}"
        return f"map {map_seed}, {part}, other streets" if options.off_map else f"map {map_seed}, {part}"
    return f"map {map_seed}, " + (f"half of it; {images}, the other half" if options.off_map else images)
