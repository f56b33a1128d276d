"""The region around a key sphere in which a camera can be localised: as the map predicts it, against poses tried.

`MIN_SHARE` of `view_synthesis.region` was chosen on town 3; the towns reported here are others.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import describe
from benchmarks.report import Bound, Report, Table
from cycab_sim.params import LightParams, RenderParams
from cycab_sim.renderer import Renderer
from cycab_sim.worlds import build_world
from dense_localizer.acceptance import judge
from dense_localizer.params import LocalizerParams
from photometric import View, build_pyramid, prepare_reference, register
from photometric.structure import find_structure
from sphere_geometry import SE3, Pinhole, Spherical
from sphere_map.sphere import T_BODY_OPTICAL, Sphere
from view_synthesis.region import region_radii

HELP = "region of validity of key spheres: predicted against poses tried, both kinds of error"
SPHERE, CAMERA = Spherical(1024, 512), Pinhole(400, 300, 250.0, 250.0, 199.5, 149.5)
HEIGHT_M, LOW_M, CLEARANCE_M = 1.6, 0.8, 1.0  # of camera and of what stands in the way; to the next wall
NOISE = 2.0  # grey levels
GUESS_M, GUESS_DEG = 0.1, 1.0  # how far off a prediction is: the one before the pose tried
GOOD_M, GOOD_DEG = 0.1, 1.0  # error of a pose that is good enough to drive by
FARTHEST_M, NUM_TRIED = 16.0, 24  # tried evenly up to there, for each sphere
PARAMS = LocalizerParams()


@dataclass(frozen=True)
class Trial:
    """One pose tried: its distance in m, the region's radius towards it and that stored, whether it worked."""

    distance: float
    radius_there: float
    radius: float
    has_worked: bool


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--region-seeds", type=int, nargs="+", default=[41, 42], help="of towns (41 42)")
    parser.add_argument("--region-spheres", type=int, default=5, help="along each taught path (5)")


def run(options: argparse.Namespace) -> Report:
    """Try poses in every town."""
    report = Report("region", [], [], [describe(options.threads)])
    rows, found = [], []
    for seed in options.region_seeds:
        trials = try_town(seed, 2 if options.quick else options.region_spheres)
        found += trials
        radii = sorted({trial.radius for trial in trials})
        rows.append((str(seed), str(len(trials)), f"{radii[0]:.1f} to {radii[-1]:.1f}",
                     *(f"{100 * value:.1f}" for value in (*errors(trials, True), *errors(trials, False)))))  # fmt: skip
    columns = ("town", "poses", "radii m", "fails inside %", "works outside %", "by direction: inside %", "outside %")
    report.tables.append(Table("Predicted region, by the radius stored and by direction", columns, rows))
    for name, value in zip(("inside that fail", "outside that work"), errors(found, True), strict=True):
        report.bounds.append(Bound(f"poses predicted {name}, of {len(found)} tried", 10.0, 100.0 * value, "%"))
    return report


def errors(trials: list[Trial], is_stored: bool) -> tuple[float, float]:
    """Return the share of those predicted inside that failed, and of those predicted outside that worked."""
    inside = [one for one in trials if one.distance < (one.radius if is_stored else one.radius_there)]
    outside = [one for one in trials if one not in inside]
    fails, works = sum(not one.has_worked for one in inside), sum(one.has_worked for one in outside)
    return fails / max(len(inside), 1), works / max(len(outside), 1)


def try_town(seed: int, num_spheres: int) -> list[Trial]:
    """Return what became of poses around the spheres of one town."""
    world = build_world("town", seed, "block")
    renderer = Renderer(world.mesh, RenderParams(num_threads=1), LightParams())
    rng = np.random.default_rng([seed, 12])
    trials = []
    for distance in np.linspace(3.0, float(world.path.length) - 3.0, num_spheres):
        x, y, yaw, _ = world.path.at(np.array(distance))
        T = SE3.from_planar(float(x), float(y), float(yaw)) @ SE3.from_parts(np.eye(3), [0.0, 0.0, HEIGHT_M])
        levels, range_m = renderer.render(SPHERE, T, is_grey=True)
        sphere = Sphere(noisy(levels, rng), range_m.astype(np.float32), SPHERE)
        trials += try_sphere(sphere, T, renderer, rng)
    return trials


def try_sphere(sphere: Sphere, T: SE3, renderer: Renderer, rng: np.random.Generator) -> list[Trial]:
    """Try poses around one sphere, where nothing is in the way."""
    reference = prepare_reference(sphere.grey, sphere.range_m, sphere.camera, PARAMS.registration)
    view = View(reference, T)
    radii = region_radii(sphere)
    trials = []
    for distance in np.linspace(0.5, FARTHEST_M, NUM_TRIED):
        azimuth = rng.uniform(0.0, 2 * np.pi)
        direction = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        if free_way(renderer, T, direction) < distance + CLEARANCE_M:
            continue
        turn = SE3.exp([0, 0, 0, 0, 0, rng.uniform(-np.pi, np.pi)])
        T_camera = T @ SE3.from_parts(np.eye(3), direction * distance) @ turn @ T_BODY_OPTICAL
        there = radii[round(azimuth / (2 * np.pi) * len(radii)) % len(radii)]
        has_worked = localise(renderer, view, T_camera, rng)
        trials.append(Trial(float(distance), float(there), float(np.median(radii)), has_worked))
    return trials


def free_way(renderer: Renderer, T: SE3, direction: NDArray[np.float64]) -> float:
    """Return how far one can go in a direction, at the height of the camera and of a bonnet."""
    ray = (T.rotation @ direction).astype(np.float32)[None]
    return float(min(renderer.measure(T.translation - [0, 0, down], ray)[0] for down in (0.0, HEIGHT_M - LOW_M)))


def localise(renderer: Renderer, view: View, T_camera: SE3, rng: np.random.Generator) -> bool:
    """Say whether an image taken at a pose is aligned to one sphere alone, accepted, and right."""
    levels, _ = renderer.render(CAMERA, T_camera, is_grey=True)
    pyramid = build_pyramid(noisy(levels, rng), CAMERA, PARAMS.registration.pyramid)
    shift, turn = rng.normal(size=(2, 3))
    guess = np.concatenate(
        [shift / np.linalg.norm(shift) * GUESS_M, turn / np.linalg.norm(turn) * np.radians(GUESS_DEG)]
    )
    alignment = register(pyramid, [view], T_camera @ SE3.exp(guess), PARAMS.registration)
    structure = find_structure(pyramid, [view], alignment, PARAMS.registration) if alignment.is_converged else None
    limits = PARAMS.acceptance, PARAMS.registration.max_mad
    verdict = judge(alignment, alignment.covariance, 0.0, None, *limits, structure)
    if not verdict.is_accepted:
        return False
    off_m, off_rad = T_camera.distance(alignment.T_world_camera)
    return bool(off_m < GOOD_M and np.degrees(off_rad) < GOOD_DEG)


def noisy(levels: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return an image as a camera gives it."""
    return np.clip(np.rint(levels + rng.normal(0.0, NOISE, levels.shape)), 1, 255).astype(np.uint8)
