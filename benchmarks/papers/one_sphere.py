"""`mad` and `around`: what one key sphere is good for, on the way past it and all around it (M15 fig. 3 and 13).

Ideal spheres of a simulated town, without messages: what is measured is the alignment, not stereo or tracking.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from numpy.typing import NDArray
from tqdm import tqdm

from benchmarks.papers.result import JudgedFigure, write_result
from cycab_sim.params import SimParams
from cycab_sim.sensors.imaging import RenderedFrame
from cycab_sim.simulator import Simulator
from cycab_sim.vehicle import VehicleCommand
from sphere_mapping.constants import MAX_GRAY
from sphere_mapping.params import KeySphereParams
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.params import build
from sphere_nav.photometric import View, build_pyramid, prepare_reference, register
from sphere_nav.ros.conversions.stamps import SECOND
from sphere_nav.spheres.sphere import Sphere
from sphere_nav_tools.cli.demo.demo import new_folder
from sphere_nav_tools.cli.demo.plots import save_figure

STEP, NUM_SPHERES = 0.2, 500  # m; M15 fig. 3 has 500 images
MAX_MAD = KeySphereParams().max_mad_share * MAX_GRAY  # grey levels: eq. 12
NUM_POSES, FARTHEST = 240, 6.0  # around a sphere; m
BESIDE = 20.0  # m along the path, where that sphere is
TURNS, LOOK = 7.3, 2.4  # of the spiral; of the camera for each of them
CLEAR = 0.6  # m between the camera and the nearest thing
GUESS_M, GUESS_DEG = 0.1, 1.0  # how far off the pose before was
GOOD_M, GOOD_DEG = 0.1, 1.0  # of a pose to drive by
RING, SHARE = 0.5, 0.95  # m wide; of its poses that must be good
WORLD: Mapping[str, Any] = {"path": "two_turns", "sphere.width": 512, "camera.size": "800,600"}


class OneSphere(ABC):
    """A town of a seed, and where results go."""

    purpose = ""

    def __init__(self, name: str, output: Path, seed: int) -> None:
        self.name, self.seed, self.folder = name, seed, new_folder(output)
        self.simulator = Simulator(build(SimParams, dict(WORLD) | {"seed": seed}))

    @abstractmethod
    def run(self) -> bool:
        """Measure, draw, judge; True where every bound is kept."""

    def see(self, camera: str, pose: Array) -> tuple[RenderedFrame, SE3]:
        """Return what a camera of the car at a pose (3,) in the world sees, and where the camera is."""
        simulator = self.simulator
        simulator.teleport(*map(float, pose))
        simulator.step(VehicleCommand(), SECOND // 5)
        return simulator.capture(camera), simulator.T_world_base @ simulator.mounts[camera].T_base_camera

    def sphere(self, pose: Array) -> tuple[Sphere, SE3]:
        """Return the sphere of the car at a pose (3,), and where it is."""
        frame, T_world_sphere = self.see("sphere", pose)
        return Sphere(frame.image, frame.range_m, frame.camera), T_world_sphere  # type: ignore[arg-type]

    def reference(self, pose: Array) -> tuple[View, Sphere]:
        """Return a sphere as a reference."""
        sphere, T_world_sphere = self.sphere(pose)
        return View(prepare_reference(sphere.gray, sphere.range_m, sphere.camera), T_world_sphere), sphere

    def finish(self, figure: plt.Figure, figures: list[JudgedFigure], more: Mapping[str, Any]) -> bool:
        """Write picture and result."""
        save_figure(figure, self.folder / f"{self.name}.png")
        return write_result(self.folder, self.name, self.seed, figures, more)


class MadOverDistance(OneSphere):
    """M15 fig. 3: the MAD grows with the way, faster where things are near; at eq. 12 the next reference begins."""

    purpose = "median absolute deviation over the way from a key sphere, near and far from houses (M15 fig. 3)"

    def run(self) -> bool:
        """Drive past one reference after the other."""
        poses = self.simulator.path.at(STEP * np.arange(NUM_SPHERES))[:, :3]
        view, mads, begins, nearness = self.reference(poses[0])[0], [0.0], [0], [np.nan]
        for index in tqdm(range(1, len(poses)), desc="spheres", disable=None):
            sphere, T_world_sphere = self.sphere(poses[index])
            alignment = register(build_pyramid(sphere.gray, sphere.camera), [view], T_world_sphere)
            mads.append(alignment.mad)
            nearness.append(float(np.mean(1.0 / sphere.range_m[np.isfinite(sphere.range_m)])))
            if alignment.mad > MAX_MAD or not alignment.is_converged:
                begins.append(index)
                view, _ = self.reference(poses[index])
        ways, near = by_reference(np.array(begins), np.array(nearness))
        figure, (upper, lower) = plt.subplots(2, 1, figsize=(10, 7), sharex=True)
        way = STEP * np.arange(len(mads))
        upper.plot(way, mads, color="tab:blue")
        upper.axhline(MAX_MAD, color="tab:red", label="eq. 12: the next reference")
        upper.plot(way[begins], np.zeros(len(begins)), "k^", label=f"{len(begins)} references")
        upper.set(ylabel="MAD [grey levels]", title="Residual over the way from the reference")
        lower.plot(way, nearness, color="tab:green")
        lower.set(xlabel="way [m]", ylabel="mean of 1 / range [1/m]")
        for axes in (upper, lower):
            axes.grid(alpha=0.3)
        upper.legend()
        figures = [
            JudgedFigure(f"references on {STEP * NUM_SPHERES:g} m", len(begins)),
            JudgedFigure("way by a reference, median", float(np.median(ways)), "m"),
            JudgedFigure("ways and nearness, rank correlation", rank_correlation(ways, near)),
        ]
        return self.finish(figure, figures, {"mad": mads, "begins": begins})


def by_reference(begins: Array, nearness: Array) -> tuple[Array, Array]:
    """Return the way (N,) m that each reference but the last served, and the mean nearness (N,) 1/m on it."""
    parts = np.split(nearness, begins[1:])[:-1]
    return STEP * np.diff(begins), np.array([np.nanmean(part) for part in parts])


def rank_correlation(values: Array, others: Array) -> float:
    """Return Spearman's rank correlation of two series (N,); equal values share no rank."""
    return float(np.corrcoef(np.argsort(np.argsort(values)), np.argsort(np.argsort(others)))[0, 1])


@dataclass(frozen=True, eq=False)
class Tried:
    """Poses (N, 3) m, rad around a sphere; how far off each was found, (N,) m and deg; NaN: not found."""

    poses: Array
    meters: Array
    degrees: Array

    @property
    def is_good(self) -> NDArray[np.bool_]:
        """Which were found well enough to drive by."""
        return (self.meters <= GOOD_M) & (self.degrees <= GOOD_DEG)


class AroundOneSphere(OneSphere):
    """M15 fig. 13: a camera is moved around one sphere and looks in all directions."""

    purpose = "a camera of 800 x 600 pixels all around one key sphere, in all directions (M15 fig. 13)"

    def run(self) -> bool:
        """Try poses on a spiral, as far as there is room."""
        middle = self.simulator.path.at(BESIDE)[:3]
        (view, sphere), rng = self.reference(middle), np.random.default_rng([self.seed, 13])
        poses, rows = np.array(list(spiral(middle, sphere))), []
        for pose in tqdm(poses, desc="poses", disable=None):
            frame, truth = self.see("camera", pose)
            shift, turn = rng.normal(size=(2, 3))
            shift, turn = GUESS_M * shift / np.linalg.norm(shift), np.radians(GUESS_DEG) * turn / np.linalg.norm(turn)
            pyramid = build_pyramid(frame.image, frame.camera)
            alignment = register(pyramid, [view], truth @ SE3.exp(np.concatenate([shift, turn])))
            meters, radians = truth.distance(alignment.T_world_camera)
            rows.append((float(meters), float(np.degrees(radians))) if alignment.is_converged else (np.nan, np.nan))
        tried = Tried(poses, *np.array(rows).T)
        return self.finish(self.draw(tried, middle), list(ring_figures(tried, middle)), {})

    def draw(self, tried: Tried, middle: Array) -> plt.Figure:
        """Draw where the camera was, which way it looked, and whether it was found."""
        figure, axes = plt.subplots(figsize=(8, 8))
        x, y, yaw = tried.poses.T
        for is_so, color, name in (
            (tried.is_good, "tab:blue", f"found within {GOOD_M:g} m and {GOOD_DEG:g} deg"),
            (~tried.is_good, "tab:red", "not found so"),
        ):
            axes.quiver(
                *(part[is_so] for part in (x, y, np.cos(yaw), np.sin(yaw))), color=color, width=0.002, label=name
            )
        axes.plot(*middle[:2], "k*", markersize=14, label="the sphere")
        axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title="A camera around one sphere")
        axes.grid(alpha=0.3)
        axes.legend()
        return figure


def spiral(middle: Array, sphere: Sphere) -> Iterator[Array]:
    """Yield poses (3,) around the sphere of one, from near to far, each turned elsewhere, where there is room."""
    rows = sphere.camera.height // 2 + np.arange(0, sphere.camera.height // 36 + 1)  # from the horizon 5 deg down
    for part in np.arange(NUM_POSES) / NUM_POSES:
        angle, radius = 2 * np.pi * TURNS * part, FARTHEST * (part + 0.5 / NUM_POSES)
        column = int((0.5 - angle / (2 * np.pi)) % 1.0 * sphere.camera.width)
        if sphere.range_m[rows, column].min() > radius + CLEAR:
            heading = middle[2] + angle
            x, y = middle[:2] + radius * np.array([np.cos(heading), np.sin(heading)])
            yield np.array([x, y, middle[2] + LOOK * angle])


def ring_figures(tried: Tried, middle: Array) -> Iterator[JudgedFigure]:
    """Tell how far out the camera is found; M15 says up to 3.5 m."""
    radius = np.hypot(*(tried.poses[:, :2] - middle[:2]).T)
    ring = (radius / RING).astype(int)
    shares = [float(np.mean(tried.is_good[ring == number])) for number in np.unique(ring)]
    poor = np.unique(ring)[np.array(shares) < SHARE]
    reach = RING * (int(poor[0]) if len(poor) else int(ring.max()) + 1)
    yield JudgedFigure("poses tried", len(radius))
    yield JudgedFigure(f"{100 * SHARE:g} % of each ring found, up to", reach, "m", 3.5, is_minimum=True)
    yield JudgedFigure("error within that, RMSE", float(np.sqrt(np.nanmean(tried.meters[radius < reach] ** 2))), "m")
    yield JudgedFigure("all poses found", 100.0 * float(tried.is_good.mean()), "%")
