"""Views synthesised from key spheres of a town against the town itself: half way between spheres, and off the track."""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import describe
from benchmarks.report import Bound, Report, Table
from cycab_sim.params import LightParams, RenderParams
from cycab_sim.rendering.renderer import Renderer
from cycab_sim.world.worlds import World, build_world
from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.spheres.range_codec import decode_ranges, encode_ranges
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, Sphere
from sphere_nav.view_synthesis.surface import surface_of
from sphere_nav.view_synthesis.synthesis import PlacedSurface, SynthesizedView, synthesize

HELP = "views from key spheres: PSNR half way and 2 m off the track, frames per second at 800 x 600"
WIDTH, SPACING_M, HEIGHT_M = 2048, 2.0, 1.6
NOISE, RANGE_NOISE = 2.0, 0.005  # grey levels; share of the range, smooth over some pixels as matching makes it
CAMERA = Pinhole(800, 600, 500.0, 500.0, 399.5, 299.5)
HEADINGS_DEG = (0.0, 70.0)
OFF_TRACK_M = 2.0
NUM_TIMED = 10


@dataclass(frozen=True)
class Found:
    """One view: peak signal to noise in dB of what is known, share of holes, views per second of CPU."""

    place: str
    psnr: float
    holes: float
    rate: float


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--view-seeds", type=int, nargs="+", default=[31, 32], help="of towns (31 32)")
    parser.add_argument("--view-places", type=int, default=4, help="along each taught path (4)")
    parser.add_argument("--view-pictures", type=Path, metavar="DIR", help="keep views and truth side by side")


def run(options: argparse.Namespace) -> Report:
    """Measure in every town."""
    found = [
        one
        for seed in options.view_seeds
        for one in measure(seed, 1 if options.quick else options.view_places, options.view_pictures)
    ]
    rows, bounds = [], []
    for place, limit in (("half way", 26.0), ("2 m off the track", 22.0)):
        here = [one for one in found if one.place == place]
        levels, holes = np.array([one.psnr for one in here]), np.array([one.holes for one in here])
        rows.append((place, str(len(here)), *(f"{value:.1f}" for value in (levels.min(), np.median(levels))),
                     f"{100 * np.median(holes):.1f}", f"{100 * holes.max():.1f}"))  # fmt: skip
        bounds.append(Bound(f"PSNR {place}, median of {len(here)} views", limit, float(np.median(levels)), "dB", True))
        bounds.append(Bound(f"PSNR {place}, worst view", limit, float(levels.min()), "dB", True))
    bounds.append(
        Bound("views at 800 x 600, one core", 15.0, float(np.median([one.rate for one in found])), "/s", True)
    )
    columns = ("where", "views", "PSNR min dB", "median dB", "holes median %", "max %")
    title = f"Two key spheres {WIDTH} x {WIDTH // 2}, {SPACING_M:g} m apart"
    return Report("view_synthesis", [Table(title, columns, rows)], bounds, [describe(options.threads)])


def measure(seed: int, num_places: int, pictures: Path | None) -> list[Found]:
    """Return what views in one town are worth."""
    world = build_world("town", seed, "block")
    renderer = Renderer(world.mesh, RenderParams(), LightParams(), num_threads=1)
    rng = np.random.default_rng([seed, 8])
    found = []
    for number, start in enumerate(np.linspace(5.0, float(world.path.length) - 10.0, num_places)):
        poses = [pose_at(world, start), pose_at(world, start + SPACING_M)]
        surfaces = [surface_of(see(renderer, pose, rng)) for pose in poses]
        for place, aside in (("half way", 0.0), ("2 m off the track", OFF_TRACK_M)):
            for heading in HEADINGS_DEG:
                turn = SE3.exp([0, 0, 0, 0, 0, np.radians(heading)])
                T = pose_at(world, start + 0.5 * SPACING_M, aside) @ turn @ T_BODY_OPTICAL
                distances = np.array([np.linalg.norm(T.translation - pose.translation) for pose in poses])
                weights = distances[::-1] / distances.sum()
                placed = [PlacedSurface(*one) for one in zip(surfaces, poses, weights, strict=True)]
                view, rate = timed(placed, T)
                truth, _ = renderer.render(CAMERA, T)
                found.append(Found(place, psnr(view, truth), 1.0 - float(view.is_known.mean()), rate))
                if pictures is not None:
                    name = f"{seed}_{number}_{place.replace(' ', '_')}_{heading:g}.png"
                    keep(pictures / name, view, truth)
    return found


def pose_at(world: World, distance_m: float, aside_m: float = 0.0) -> SE3:
    """Return the pose at a distance along the taught path, moved to the left."""
    x, y, yaw, _ = world.path.at(np.array(distance_m))
    return SE3.from_planar(float(x), float(y), float(yaw)) @ SE3.from_parts(np.eye(3), [0.0, aside_m, HEIGHT_M])


def see(renderer: Renderer, pose: SE3, rng: np.random.Generator) -> Sphere:
    """Return the sphere of a place as a map has it: noise, errors of range, and the coding of range."""
    camera = Spherical(WIDTH, WIDTH // 2)
    levels, range_m = renderer.render(camera, pose)
    image = np.clip(np.rint(levels + rng.normal(0, NOISE, levels.shape)), 1, 255).astype(np.uint8)
    wave = cv2.GaussianBlur(rng.normal(size=range_m.shape), (0, 0), 4.0)
    wave *= RANGE_NOISE / wave.std()
    coded = decode_ranges(encode_ranges((range_m * (1.0 + wave)).astype(np.float32)))
    return Sphere(image, coded, camera)


def timed(placed: list[PlacedSurface], T: SE3) -> tuple[SynthesizedView, float]:
    """Return a view, and views per second of CPU."""
    view = synthesize(placed, T, CAMERA)
    begin = time.process_time()
    for _ in range(NUM_TIMED):
        view = synthesize(placed, T, CAMERA)
    return view, NUM_TIMED / (time.process_time() - begin)


def psnr(view: SynthesizedView, truth: NDArray[np.float32]) -> float:
    """Return the peak signal to noise ratio in dB over what the view shows."""
    error = (view.image.astype(np.float32) - truth)[view.is_known]
    return float(10.0 * np.log10(255.0**2 / np.mean(error**2)))


def keep(path: Path, view: SynthesizedView, truth: NDArray[np.float32]) -> None:
    """Write view and truth side by side."""
    path.parent.mkdir(parents=True, exist_ok=True)
    both = np.hstack([view.image, np.clip(np.rint(truth), 0, 255).astype(np.uint8)])
    cv2.imwrite(str(path), cv2.cvtColor(both, cv2.COLOR_RGB2BGR))
