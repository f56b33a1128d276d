"""N17 fig. 3, 6 and 7: how the particles of algorithm 2 find a kidnapped panorama in bare geometry.

Algorithm 2 as it is printed: a fixed number of particles, resampled with every image, and nothing put to the belief
from elsewhere. `mcl_depth` does more; what that gives is measured by `benchmarks mcl_town`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from tqdm import tqdm

from benchmarks.papers.drives import ASIDE, CAMERA_X, HEIGHT, NEAR, PANORAMA, SURVEY_SPACING
from benchmarks.papers.result import JudgedFigure, write_result
from cycab_sim.params import SimParams
from cycab_sim.simulator import Simulator
from cycab_sim.vehicle import VehicleCommand
from cycab_sim.world.town import draw_plan
from cycab_sim.world.worlds import geometry_cloud
from mcl_depth.belief.hypotheses import Lineage
from mcl_depth.belief.motion_model import MotionModel, compose_planar, relative_motion, sample_motion
from mcl_depth.belief.particles import Particles, adjust_headings, interpolate_similarity
from mcl_depth.belief.resampling import compute_weights, low_variance_indices, sample_uniform
from mcl_depth.geometry.cloud import cloud_from_points
from mcl_depth.likeness.comparison import GradientFeatures, num_alpha_for, visual_features
from mcl_depth.likeness.level_view import level_view
from mcl_depth.likeness.similarity_cache import Comparison
from mcl_depth.params import FilterParams
from mcl_depth.site import Site
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.params import build
from sphere_nav.ros.conversions.stamps import SECOND
from sphere_nav_tools.cli.demo.demo import new_folder
from sphere_nav_tools.cli.demo.plots import save_figure

SIDE = 100.0  # m, of the part of the town in which the camera may be
STEP = 1.0  # m from image to image, a second each
WAY_SHARE, TURN_DEG = 0.05, 1.0  # what odometry has wrong: of a way; after a way of one metre, growing with its root
SETTINGS = {  # of the curves: particles, and whether their headings are adjusted
    "1000, adjusted": (1000, True),
    "1000, as drawn": (1000, False),
    "4000, adjusted": (4000, True),
    "4000, as drawn": (4000, False),
}
DISTANCES = ("mean", "best weight", "nearest")


@dataclass(frozen=True, eq=False)
class KidnappedDrive:
    """A drive from anywhere: features of its images, true poses and odometry (K, 3) m, rad of the level camera."""

    images: list[GradientFeatures]
    truth: Array
    odometry: Array


@dataclass(frozen=True, eq=False)
class ParticleCurves:
    """Of a run: distances (K, 3) m of `DISTANCES`, hit rates (K, 2) of both caches, and a way.

    `trajectory` (K, 3): of the particle of the highest accumulated weight.
    """

    distances: Array
    hit_rates: Array
    trajectory: Array


class Convergence:
    """Drives from anywhere in a town, each run with every setting."""

    purpose = "particles of a kidnapped panorama in bare geometry, 1000 and 4000 of them (N17 fig. 3, 6, 7)"

    def __init__(self, name: str, output: Path, seed: int, num_seeds: int = 20, num_images: int = 20) -> None:
        self.name, self.seed = name, seed
        self.num_seeds, self.num_images = num_seeds, num_images
        self.folder = new_folder(output)
        plan = draw_plan(seed)
        x, y, half = plan.east / 2, plan.north / 2, SIDE / 2
        limits = f"{x - half:.2f},{y - half:.2f},{x + half:.2f},{y + half:.2f}"
        cloud = cloud_from_points(geometry_cloud(seed, SURVEY_SPACING, "town").astype(np.float32), "town")
        self.site = Site(cloud, HEIGHT, build(FilterParams, {"area.limits": limits}), is_ready=False)
        simulation = {"seed": seed, "path": "block", "traffic.density": "usual"} | PANORAMA
        self.simulator = Simulator(build(SimParams, simulation))

    def run(self) -> bool:
        """Record, run, draw, judge; True where every bound is kept."""
        drives = list(tqdm(self.record(), desc="drives", total=self.num_seeds, disable=None))
        found: dict[str, list[ParticleCurves]] = {}
        for setting, (count, is_adjusted) in SETTINGS.items():
            numbered = tqdm(enumerate(drives), desc=setting, total=len(drives), disable=None)
            found[setting] = [
                run_particles(self.site, drive, count, self._lot(number, 29), is_adjusted=is_adjusted)
                for number, drive in numbered
            ]
        plot_curves(self.folder / "curves.png", found)
        plot_ways(self.folder / "ways.png", found[next(iter(SETTINGS))], drives)
        more = {"median_m": {name: np.median(_distances(some), axis=0).tolist() for name, some in found.items()}}
        return write_result(self.folder, self.name, self.seed, list(figures(found, drives)), more)

    def _lot(self, number: int, purpose: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, number, purpose])

    def record(self) -> Iterator[KidnappedDrive]:
        """Draw the images of each drive."""
        path = self.simulator.path
        for number in range(self.num_seeds):
            rng = self._lot(number, 83)
            line = path.at(rng.uniform(0.0, path.length) + STEP * np.arange(self.num_images))[:, :3]
            line = compose_planar(line, np.array([0.0, rng.uniform(-ASIDE, ASIDE), 0.0]))
            images = []
            for x, y, yaw in line:
                self.simulator.teleport(float(x), float(y), float(yaw))
                frame = self.simulator.capture("camera")
                camera = self.site.depth_map.camera
                images.append(visual_features(*level_view(frame.image, frame.camera, np.eye(3), camera)))
                self.simulator.step(VehicleCommand(), SECOND)
            truth = compose_planar(line, np.array([CAMERA_X, 0.0, 0.0]))
            yield KidnappedDrive(images, truth, noisy_odometry(truth, rng))


def run_particles(
    site: Site, drive: KidnappedDrive, count: int, rng: np.random.Generator, *, is_adjusted: bool
) -> ParticleCurves:
    """Let algorithm 2 run over the images of a drive, `count` particles all over the site at first."""
    motion, lineage = MotionModel(site.params.motion), Lineage()
    cache, num_headings = site.depth_map.cache, num_alpha_for(site.params.heading_step_deg)
    particles = sample_uniform(site.area, count, rng)
    distances, rates = [], []
    for index, visual in enumerate(drive.images):
        step = motion.step((index + 1) * SECOND, SE3.from_planar(*map(float, drive.odometry[index])))
        particles = particles.with_poses(sample_motion(particles.poses, step, rng))
        comparison = Comparison(visual, site.depth_map, num_headings)
        cache.num_hits = cache.num_misses = 0
        curves = comparison.curves(particles.poses)
        rates.append((comparison.hit_rate, cache.hit_rate))
        if is_adjusted:
            particles = adjust_headings(particles, curves, rng)
        similarities = interpolate_similarity(curves, particles.poses[:, 2])
        particles = particles.reweight(compute_weights(similarities, particles.weights))
        distances.append(distances_of(particles, drive.truth[index]))
        particles = lineage.add((index + 1) * SECOND, particles)
        particles = particles.select(low_variance_indices(particles.weights, count, rng.random()))
    return ParticleCurves(np.array(distances), np.array(rates), np.array([pose for _, pose in lineage.trajectory()]))


def distances_of(particles: Particles, truth: Array) -> tuple[float, float, float]:
    """Return how far from a true pose (3,) particles are on average, the heaviest one, and the nearest one, in m."""
    meters = np.hypot(*(particles.poses[:, :2] - truth[:2]).T)
    return float(particles.weights @ meters), float(meters[np.argmax(particles.weights)]), float(meters.min())


def noisy_odometry(truth: Array, rng: np.random.Generator) -> Array:
    """Return true poses (K, 3) as wheels have them, from the origin."""
    poses = [np.zeros(3)]
    for before, after in pairwise(truth):
        way = relative_motion(before, after)
        way[:2] *= 1.0 + WAY_SHARE * rng.standard_normal()
        way[2] += np.radians(TURN_DEG) * np.sqrt(np.hypot(way[0], way[1])) * rng.standard_normal()
        poses.append(compose_planar(poses[-1][None], way)[0])
    return np.array(poses)


def figures(found: dict[str, list[ParticleCurves]], drives: list[KidnappedDrive]) -> Iterator[JudgedFigure]:
    """Judge: N17 IV says what the adjustment of headings saves."""
    shares = {}
    for setting, some in found.items():
        last = _distances(some)[:, -1]
        shares[setting] = 100.0 * float(np.mean(last[:, 0] <= NEAR))
        yield JudgedFigure(f"{setting}: mean within {NEAR:g} m at the end", shares[setting], "%")
        for index, name in enumerate(DISTANCES):
            yield JudgedFigure(f"{setting}: {name} at the end, median", float(np.median(last[:, index])), "m")
        ways = [np.sqrt(np.mean(_off(run, drive) ** 2)) for run, drive in zip(some, drives, strict=True)]
        yield JudgedFigure(f"{setting}: way by accumulated weight, RMSE", float(np.median(ways)), "m")
        rates = np.mean([run.hit_rates for run in some], axis=(0, 1))
        yield JudgedFigure(f"{setting}: similarities reused", 100.0 * float(rates[0]), "%")
        yield JudgedFigure(f"{setting}: depth images reused", 100.0 * float(rates[1]), "%")
    yield JudgedFigure("runs of each setting", float(len(drives)), "", 20.0, is_minimum=True)
    gain = shares["1000, adjusted"] - shares["1000, as drawn"]
    yield JudgedFigure("adjusted against drawn headings, 1000 particles", gain, "%", 0.0, is_minimum=True)


def plot_curves(path: Path, found: dict[str, list[ParticleCurves]]) -> None:
    """Draw the three distances over the images for every setting, median and quartiles, and the use of the caches."""
    figure, panels = plt.subplots(2, 3, figsize=(14, 8))
    for axes, (setting, some) in zip(panels[:, :2].ravel(), found.items(), strict=True):
        all_of_them = _distances(some)
        number = np.arange(1, all_of_them.shape[1] + 1)
        for index, name in enumerate(DISTANCES):
            low, middle, high = np.percentile(all_of_them[..., index], (25, 50, 75), axis=0)
            (line,) = axes.plot(number, middle, label=name)
            axes.fill_between(number, low, high, color=line.get_color(), alpha=0.2)
        axes.set(title=f"{setting}: {len(some)} runs", xlabel="image", ylabel="distance from the truth [m]")
        axes.set(yscale="log", ylim=(0.02, 100.0))
        axes.legend()
    for axes, index, what in zip(panels[:, 2], (0, 1), ("similarities", "depth images"), strict=True):
        for setting, some in found.items():
            rates = 100.0 * np.mean([run.hit_rates[:, index] for run in some], axis=0)
            axes.plot(np.arange(1, len(rates) + 1), rates, label=setting)
        axes.set(title=f"{what} found in their cache", xlabel="image", ylabel="share [%]", ylim=(0.0, 101.0))
        axes.legend()
    for axes in panels.ravel():
        axes.grid(alpha=0.3)
    save_figure(figure, path)


def plot_ways(path: Path, some: list[ParticleCurves], drives: list[KidnappedDrive]) -> None:
    """Draw the ways of the particles of the highest accumulated weight beside the truth."""
    figure, axes = plt.subplots(figsize=(8, 8))
    for number, (run, drive) in enumerate(zip(some, drives, strict=True)):
        axes.plot(*drive.truth[:, :2].T, "-", color="0.6", linewidth=3, label="truth" if not number else None)
        name = "highest accumulated weight" if not number else None
        axes.plot(*run.trajectory[:, :2].T, ".-", color="tab:red", linewidth=1, markersize=3, label=name)
    axes.set(aspect="equal", adjustable="datalim", xlabel="x [m]", ylabel="y [m]", title="Ways of 1000 particles")
    axes.grid(alpha=0.3)
    axes.legend()
    save_figure(figure, path)


def _distances(some: list[ParticleCurves]) -> Array:
    return np.stack([run.distances for run in some])


def _off(run: ParticleCurves, drive: KidnappedDrive) -> Array:
    return np.hypot(*(run.trajectory[:, :2] - drive.truth[-len(run.trajectory) :, :2]).T)
