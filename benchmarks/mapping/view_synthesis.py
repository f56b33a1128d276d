"""Views synthesised from key spheres of a town against the town itself: half way between spheres, and off the track."""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass

import cv2
import numpy as np

from benchmarks.mapping.drawn import noisy, pose_at, town
from benchmarks.report import Bound, Headline, Report, Table
from cycab_sim.rendering.renderer import Renderer
from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.spheres.range_codec import decode_ranges, encode_ranges
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, Sphere
from sphere_nav.view_synthesis.surface import surface_of
from sphere_nav.view_synthesis.synthesis import PlacedSurface, synthesize

HELP = "views from key spheres: PSNR half way and 2 m off the track, views per second at 800 x 600"
WIDTH, SPACING_M, RANGE_NOISE = 2048, 2.0, 0.005  # share of the range, smooth over some pixels as matching makes it
CAMERA, HEADINGS_DEG = Pinhole(800, 600, 500.0, 500.0, 399.5, 299.5), (0.0, 70.0)
PLACES = {"half way": (0.0, 26.0), "2 m off the track": (2.0, 22.0)}  # m to the left; dB at least
NUM_TIMED = 10


@dataclass(frozen=True)
class Found:
    """One view: peak signal to noise in dB of what is known, share of holes, views per second of CPU."""

    psnr: float
    holes: float
    rate: float


def run(options: argparse.Namespace) -> Report:
    """Measure in a town, or in two."""
    is_quick = options.size == "quick"
    found: dict[str, list[Found]] = {place: [] for place in PLACES}
    for seed in range(options.seed, options.seed + (1 if is_quick else 2)):
        measure(seed, 1 if is_quick else 4, found)
    report, rows = Report("view_synthesis"), []
    for place, (_, limit) in PLACES.items():
        levels, holes = np.array([one.psnr for one in found[place]]), np.array([one.holes for one in found[place]])
        rows.append((place, f"{levels.min():.1f}", f"{100 * np.median(holes):.1f}", f"{100 * holes.max():.1f}"))
        what, told = f"PSNR {place}, median of {len(levels)} views", Headline("map", "towns")
        report.bounds.append(
            Bound(what, limit, float(np.median(levels)), "dB", True, told if place == "half way" else None)
        )
    rates = [one.rate for here in found.values() for one in here]
    report.bounds.append(Bound("views at 800 x 600, one core", 15.0, float(np.median(rates)), "/s", True))
    title = f"Two key spheres {WIDTH} x {WIDTH // 2}, {SPACING_M:g} m apart"
    report.tables.append(Table(title, ("where", "PSNR least dB", "holes median %", "most %"), rows))
    return report


def measure(seed: int, num_places: int, found: dict[str, list[Found]]) -> None:
    """Add what views in one town are worth."""
    world, renderer = town(seed)
    rng = np.random.default_rng([seed, 8])
    for start in np.linspace(5.0, float(world.path.length) - 10.0, num_places):
        poses = [pose_at(world.path, start), pose_at(world.path, start + SPACING_M)]
        surfaces = [surface_of(see(renderer, pose, rng)) for pose in poses]
        for place, (aside, _) in PLACES.items():
            for heading in HEADINGS_DEG:
                turn = SE3.exp([0, 0, 0, 0, 0, np.radians(heading)])
                T = pose_at(world.path, start + 0.5 * SPACING_M, aside) @ turn @ T_BODY_OPTICAL
                distances = np.array([np.linalg.norm(T.translation - pose.translation) for pose in poses])
                weights = distances[::-1] / distances.sum()
                placed = [PlacedSurface(*one) for one in zip(surfaces, poses, weights, strict=True)]
                found[place].append(_judge(placed, T, renderer))


def see(renderer: Renderer, pose: SE3, rng: np.random.Generator) -> Sphere:
    """Return the coloured sphere of a place as a map has it: noise, errors of range, and the coding of range."""
    camera = Spherical(WIDTH, WIDTH // 2)
    levels, range_m = renderer.render(camera, pose)
    wave = cv2.GaussianBlur(rng.normal(size=range_m.shape), (0, 0), 4.0)
    wave *= RANGE_NOISE / wave.std()
    coded = decode_ranges(encode_ranges((range_m * (1.0 + wave)).astype(np.float32)))
    return Sphere(noisy(levels, rng), coded, camera)


def _judge(placed: list[PlacedSurface], T: SE3, renderer: Renderer) -> Found:
    view, begin = synthesize(placed, T, CAMERA), time.process_time()
    for _ in range(NUM_TIMED):
        synthesize(placed, T, CAMERA)
    rate = NUM_TIMED / (time.process_time() - begin)
    truth, _ = renderer.render(CAMERA, T)
    error = (view.image.astype(np.float32) - truth)[view.is_known]
    return Found(float(10.0 * np.log10(255.0**2 / np.mean(error**2))), 1.0 - float(view.is_known.mean()), rate)
