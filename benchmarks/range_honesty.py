"""Range is measured or not known: errors by the deviation claimed, where there is texture and where there is none."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.flatness import REGIONS, fit_regions
from benchmarks.machine import describe
from benchmarks.range_worlds import CLASSES, Scene, make_scene
from benchmarks.real_rigs import room
from benchmarks.report import Bound, Report, Table
from sphere_mapping.acquisition.params import MatchParams, StitchParams
from sphere_mapping.acquisition.range.epipolar import disparities_of_ranges, range_from_disparity
from sphere_mapping.acquisition.range.matching import match_columns
from sphere_mapping.acquisition.stitching.stitcher import Stitcher
from sphere_nav.geometry import Spherical
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.params import build

HELP = "range against the truth in rooms with bare, unlit and repetitive walls; noise; planes of real pairs"
DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "spherical_stereo"
KINDS = ("vertical", "ring")
FAR_M = 30.0
REAL_BASELINE_M = 0.2
Plane = NDArray[np.float32]


@dataclass(frozen=True)
class Honesty:
    """Counts over measured pixels (n), and over all that have a range (there)."""

    there: int
    n: int
    beyond_3_sigma: int
    beyond_10_percent: int
    within_10_percent: int
    squares: float  # of errors by their deviation, those beyond 5 left out
    num_squares: int

    def __add__(self, other: Honesty) -> Honesty:
        return Honesty(*(a + b for a, b in zip(vars(self).values(), vars(other).values(), strict=True)))


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Say which rooms are seen, how finely, and where the real pairs are."""
    parser.add_argument("--seeds", type=int, nargs="+", default=[19, 20, 21, 22], help="rooms (%(default)s)")
    parser.add_argument("--range-width", type=int, default=1024, help="columns of the spheres (%(default)s)")
    parser.add_argument("--range-data", type=Path, default=DATA, metavar="DIR", help="real pairs (%(default)s)")


def run(options: argparse.Namespace) -> Report:
    """Measure rooms by both rigs, noise, and planes of real pairs."""
    seeds = options.seeds[:1] if options.quick else options.seeds
    bounds, tables = [], []
    for kind in KINDS:
        found = _rooms(kind, seeds, options)
        tables.append(_table(f"Rooms seen by a {kind} rig: measured", found))
        whole = sum(found[1:], found[0])
        bounds += [
            Bound(f"{kind}: measured pixels off by more than 3 sigma", 0.02, whole.beyond_3_sigma / whole.n, ""),
            Bound(f"{kind}: measured pixels off by more than 10 %", 0.03, whole.beyond_10_percent / whole.n, ""),
            Bound(f"{kind}: rms of errors by their sigma", 1.3, float(np.sqrt(whole.squares / whole.num_squares)), ""),
            Bound(f"{kind}: textured, measured right", 0.5, found[0].within_10_percent / found[0].there, "", True),
        ]
    bounds += [Bound(f"noise, blurred by {blur} px: measured", 0.01, _noise(blur), "") for blur in (0.0, 0.7, 1.5)]
    planes, table = _planes(options.range_data)
    bounds, tables = bounds + planes, tables + table
    return Report("range_honesty", tables, bounds, [describe(options.threads), f"rooms {seeds}"])


def _rooms(kind: str, seeds: list[int], options: argparse.Namespace) -> list[Honesty]:
    """Return the counts by class of surface, over all rooms, of what is measured."""
    nothing = Honesty(0, 0, 0, 0, 0, 0.0, 0)
    total = [nothing] * len(CLASSES)
    for seed in seeds:
        scene = make_scene(seed, kind, options.range_width)
        total = [a + b for a, b in zip(total, _counts(scene, options), strict=True)]
    return total


def _counts(scene: Scene, options: argparse.Namespace) -> list[Honesty]:
    """Return the counts of what is measured by class."""
    stitcher = Stitcher(scene.rig, build(StitchParams, {"width": options.range_width}), jobs=options.threads)
    sphere = stitcher.stitch(scene.images).sphere
    assert sphere.range_std_m is not None
    truth, kind = scene.truth(stitcher.whole, stitcher.T_rig_sphere)
    is_there = np.isfinite(truth) & (truth < FAR_M) & (sphere.image > 0).any(axis=-1)
    return [honesty(sphere.range_m, sphere.range_std_m, truth, is_there & (kind == k)) for k in range(len(CLASSES))]


def honesty(range_m: Plane, std_m: Plane, truth: Plane, keep: NDArray[np.bool_]) -> Honesty:
    """Return the counts of the pixels to keep; what is told to be far is wrong where something near is there."""
    known = keep & ~np.isnan(range_m)
    error = np.abs(range_m[known] - truth[known])
    relative = error / truth[known]
    with np.errstate(invalid="ignore"):
        by_sigma = np.where(np.isinf(range_m[known]), np.inf, error / std_m[known])
    regular = by_sigma[by_sigma < 5]
    return Honesty(
        int(keep.sum()),
        int(known.sum()),
        int((by_sigma > 3).sum()),
        int((relative > 0.1).sum()),
        int((relative <= 0.1).sum()),
        float(np.sum(regular**2)),
        int(regular.size),
    )


def _table(title: str, found: list[Honesty]) -> Table:
    rows = []
    for name, one in zip(CLASSES, found, strict=True):
        n = max(one.n, 1)
        shares = (one.n / max(one.there, 1), one.within_10_percent / max(one.there, 1), one.beyond_3_sigma / n)
        wrong = (one.beyond_10_percent / n, one.n / max(sum(other.n for other in found), 1))
        rows.append((name, *(f"{100 * share:.1f}" for share in (*shares, *wrong))))
    columns = ("surface", "with range %", "right %", "beyond 3 sigma, % of these", "off by 10 %", "share of these")
    return Table(title, columns, rows)


def _noise(blur: float) -> float:
    """Return the share of pixels that two images of independent noise have a range for."""
    rng = np.random.default_rng(0)
    images = []
    for _ in range(2):
        image = rng.normal(0, 1, (512, 1024)).astype(np.float32)
        image = cv2.GaussianBlur(image, (0, 0), blur) if blur else image
        images.append(np.clip(128 + 30 * image / image.std(), 0, 255).astype(np.uint8))
    range_m, _ = match_pair(images[0], images[1], 0.2)
    return float(1 - np.isnan(range_m).mean())


def match_pair(top: NDArray[np.uint8], bottom: NDArray[np.uint8], baseline_m: float) -> tuple[Plane, Plane]:
    """Return range and deviation (H, W) of two whole grey spheres, one above the other."""
    whole, params = Spherical(top.shape[1], top.shape[0]), MatchParams()
    everywhere = np.ones(top.shape, np.bool_)
    disparity = match_columns(top, bottom, disparities_of_ranges(whole, baseline_m, params), params, everywhere)
    return range_from_disparity(disparity, whole, baseline_m, params)


def _planes(data: Path) -> tuple[list[Bound], list[Table]]:
    """Fit planes to regions of the real pairs; tell how flat they are."""
    bounds, rows = [], []
    for name in REGIONS:
        if not (data / name).is_dir():
            continue
        top, bottom = (cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in room(data / name))
        range_m, _ = match_pair(top, bottom, REAL_BASELINE_M)
        whole = Spherical(top.shape[1], top.shape[0])
        regions = fit_regions(name, range_m, pixel_rays(whole))
        bounds.append(Bound(f"{name}: measured", 0.4, float(np.isfinite(range_m).mean()), "", is_minimum=True))
        for kind in REGIONS[name]:
            own = [region for region in regions if region.what.startswith(kind) and region.is_enough]
            off = np.concatenate([np.zeros(0), *(region.off for region in own)])
            what = f"{name}: {kind}, two thirds of the pixels off their plane by, of the distance ({len(own)} regions)"
            bounds.append(Bound(what, 0.01, _quantile(off, 0.68), ""))
        for region in regions:
            flat = (f"{100 * _quantile(region.off, share):.2f}" for share in (0.5, 0.68, 0.95))
            rows.append((name, region.what, f"{100 * region.measured:.0f}", *flat))
    columns = ("recording", "region", "measured %", "half within, % of distance", "68 % within", "95 % within")
    return bounds, [Table("Planes of recorded pairs", columns, rows)] if rows else []


def _quantile(values: NDArray[np.float64], share: float) -> float:
    return float(np.quantile(values, share)) if values.size else float("nan")
