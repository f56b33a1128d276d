"""Homes of many seeds, searched from nowhere: walks through their panoramas, in their plans and in those of others."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.homes import HEIGHT, PANORAMA, home
from benchmarks.machine import describe
from benchmarks.mcl_walks import CLOSE, NEAR, Place, read_places, steps
from benchmarks.report import Bound, Report, Table
from mcl_depth.filter import Filter
from mcl_depth.geometry.files import read_geometry
from mcl_depth.params import FilterParams
from mcl_depth.site import Site
from sphere_nav.geometry import Spherical
from sphere_nav.localization.status import Reason
from sphere_nav.params import build

HELP = "MCL in homes that are drawn from a seed, with furniture, glass and mirrors, and in real ones"
WALK, PUBLISHED_BY = 8, 15  # panoramas after which the place is asked for, and until a pose is published
MAX_CPU_MS = 100.0  # of an image while the place is searched


@dataclass(frozen=True)
class Outcome:
    """Of one walk: error m of the likeliest place at panorama `WALK`, poses that left, and how many were wrong."""

    error: float
    is_published: bool
    num_wrong: int
    is_ambiguous: bool  # at the end two places were named
    smallest_p: float
    search_ms: float  # CPU of an image while searching, median


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments; the real home is that of `--panoramas`."""
    parser.add_argument("--first-home", type=int, default=100, help="seed of the first home (100)")
    parser.add_argument("--homes", type=int, default=10, help="homes, also as the map of the one before (10)")
    parser.add_argument("--home-walks", type=int, default=16, help="walks in each (16)")


def run(options: argparse.Namespace) -> Report:
    """Walk in each home, in its own plan and in that of the next one."""
    num_homes, num_walks = (2, 4) if options.quick else (options.homes, options.home_walks)
    seeds = range(options.first_home, options.first_home + num_homes)
    report = Report("mcl_homes", notes=[describe(options.threads)])
    if options.likeness == "both":
        raise ValueError("--likeness: expected gradients or learned, found both")
    params, of = build(FilterParams, {"likeness.kind": options.likeness}), ""
    if options.likeness != "gradients":
        of = f"{options.likeness}: "
    rows, right, wrong = [], list[Outcome](), list[Outcome]()
    for seed in seeds:
        here, other = home(seed), home(seeds[(seed + 1 - seeds[0]) % num_homes])
        site = Site(here.plan, HEIGHT, params)
        found = [_walk(site, _places(images), PANORAMA, n, seed) for images in (here, other) for n in range(num_walks)]
        rows += [
            (f"home {seed}", *_figures(found[:num_walks])),
            ("its plan, images of another", *_figures(found[num_walks:])),
        ]
        right, wrong = right + found[:num_walks], wrong + found[num_walks:]
    report.bounds += _bounds(f"{of}{num_homes} homes from seed {seeds[0]}, {len(right)} walks", right)
    claims = float(sum(item.is_published for item in wrong))
    report.bounds.append(Bound(f"{of}{len(wrong)} walks in another's plan: ever a pose", 0.0, claims, ""))
    if options.panoramas.is_dir():
        site = Site(read_geometry(options.panoramas / "surfaces.csv"), HEIGHT, params)
        places = read_places(options.panoramas)
        real = [_walk(site, places, Spherical(1024, 512), n, 1) for n in range(min(num_walks, len(places)))]
        rows.append(("real", *_figures(real)))
        report.bounds += _bounds(f"{of}real home, {len(real)} walks", real)
    head = ("map", "walks", "within 1 m", "within 0.5 m", "published", "wrong poses", "ambiguous", "least p", "ms")
    report.tables.append(Table(f"after {WALK} panoramas; published by {PUBLISHED_BY}", head, rows))
    return report


def _places(images: object) -> list[Place]:
    return [Place(image, pose) for image, pose in zip(images.images, images.poses, strict=True)]  # type: ignore[attr-defined]


def _walk(site: Site, places: list[Place], camera: Spherical, start: int, seed: int) -> Outcome:
    """Walk from a panorama; images of another home are wrong wherever they are claimed to be."""
    seed += 1000 * (start // len(places))  # the second walk from a panorama is another one
    filter_ = Filter(replace(site.params, seed=seed), site.depth_map, site.area)
    error, wrong, out, chances, times, finding = np.nan, 0, 0, [], [], str(Reason.NONE)
    for index, (observation, true) in enumerate(steps(places, camera, start % len(places), seed, PUBLISHED_BY)):
        begin = time.process_time()
        estimate = filter_.update(observation)
        elapsed = 1e3 * (time.process_time() - begin)
        if estimate.T_map_level is not None:
            out += 1
            wrong += float(np.hypot(*(estimate.T_map_level.translation[:2] - true[:2]))) > NEAR
        else:
            times.append(elapsed)
        if index == WALK - 1 and estimate.belief is not None:
            error = float(np.hypot(*(estimate.belief.places[0].pose - true)[:2]))
        chances.append(estimate.status.p_chance)
        finding = str(estimate.status.reason)
    return Outcome(error, out > 0, wrong, finding == Reason.AMBIGUOUS, min(chances), float(np.median(times)))


def _bounds(what: str, found: Sequence[Outcome]) -> list[Bound]:
    near = 100.0 * float(np.mean([item.error < NEAR for item in found]))
    published = 100.0 * float(np.mean([item.is_published for item in found]))
    return [
        Bound(f"{what}: within {NEAR:g} m after {WALK}", 90.0, near, "%", is_minimum=True),
        Bound(f"{what}: a pose by panorama {PUBLISHED_BY}", 90.0, published, "%", is_minimum=True),
        Bound(f"{what}: wrong poses", 0.0, float(sum(item.num_wrong for item in found)), ""),
        Bound(f"{what}: CPU of an image, searching", MAX_CPU_MS, float(np.median([o.search_ms for o in found])), "ms"),
    ]


def _figures(found: Sequence[Outcome]) -> tuple[str, ...]:
    errors = np.array([item.error for item in found])
    return (
        str(len(found)),
        f"{np.mean(errors < NEAR):.0%}",
        f"{np.mean(errors < CLOSE):.0%}",
        f"{np.mean([item.is_published for item in found]):.0%}",
        str(sum(item.num_wrong for item in found)),
        str(sum(item.is_ambiguous for item in found)),
        f"{min(item.smallest_p for item in found):.1e}",
        f"{np.median([item.search_ms for item in found]):.0f}",
    )
