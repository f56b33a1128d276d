"""What the dense localiser says while something is wrong, and how often it complains while nothing is.

A camera with odometry drives up and down a room that has been mapped; again and again something fails for two seconds.
Undetected is a failure during which a pose more than 0.3 m or 3 degrees wrong is told as TRACKING. The delay is the
time of the fault until the first answer that is not TRACKING. Room, places and noise follow from `--world-seed`.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from benchmarks.localizer_times import RoomMap
from benchmarks.machine import describe
from benchmarks.report import Bound, Report, Table
from benchmarks.room import render
from dense_localizer.localizer import Localizer
from dense_localizer.params import LocalizerParams
from localization.status import State
from sphere_geometry import SE3, Pinhole, Spherical
from sphere_map.graph import KeySphere, SphereGraph
from sphere_map.sphere import T_BODY_OPTICAL, Sphere
from typed_params import build

HELP = "failures injected into drives of the dense localiser: undetected, delay, false alarms, NEES"
CAMERA = Pinhole(240, 180, 190.0, 190.0, 119.5, 89.5)
SPHERE = Spherical(1024, 512)
SETTINGS = {"acceptance.min_pixels": 200, "alignment.num_levels": 4}  # for images so small
PERIOD_NS = 50_000_000
SPEED, HALF_LENGTH = 1.0, 3.0  # m/s, m
FAULT_IMAGES, CALM_IMAGES = 40, 20
WRONG_M, WRONG_RAD = 0.3, np.radians(3.0)
LONG_S = 1.0  # a shorter DEGRADED is no false alarm
NOISE = 2.0  # grey levels
ODOMETRY_NOISE = 0.01  # of the motion
KIDNAPPED = SE3.exp([0.6, 0.0, -0.8, 0.0, 0.7, 0.0])

Image = NDArray[np.uint8]
Fault = Callable[["World", SE3, int], Image]


@dataclass
class World:
    """A room, its map, and another room that looks different."""

    seed: int

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)
        places = [SE3.from_planar(x, 0.0, 0.0) for x in np.arange(-HALF_LENGTH, HALF_LENGTH + 0.5)]
        nodes = [
            KeySphere(i, i + 1, T, Sphere(*render(SPHERE, T, self.seed), SPHERE, i + 1)) for i, T in enumerate(places)
        ]
        self.map = RoomMap(SphereGraph(nodes))
        self.patch = self.rng.integers(0, 255, (CAMERA.height // 20, CAMERA.width // 20)).astype(np.uint8)

    def see(self, pose: SE3, camera: Pinhole = CAMERA, seed: int | None = None) -> Image:
        """Return an image with noise."""
        grey, _ = render(camera, pose, self.seed if seed is None else seed)
        return np.clip(np.rint(grey + self.rng.normal(0.0, NOISE, grey.shape)), 1, 255).astype(np.uint8)


def _pose(t: float) -> SE3:
    """Return the camera at a time: up and down the room, weaving."""
    x = HALF_LENGTH * 0.95 * np.sin(SPEED * t / HALF_LENGTH)
    return SE3.from_planar(x, 0.4 * np.sin(0.7 * t), 0.5 * np.sin(0.5 * t)) @ T_BODY_OPTICAL


def _covered(world: World, pose: SE3, _: int) -> Image:
    image = 20.0 + world.rng.normal(0.0, NOISE, (CAMERA.height, CAMERA.width))
    return np.clip(np.rint(image), 1, 255).astype(np.uint8)


def _occluded(world: World, pose: SE3, _: int) -> Image:
    image = world.see(pose)
    patch = np.kron(world.patch, np.ones((20, 20), np.uint8))
    image[:, : int(0.7 * CAMERA.width)] = patch[:, : int(0.7 * CAMERA.width)]
    return image


def _saturated(world: World, pose: SE3, _: int) -> Image:
    return np.clip(2.2 * world.see(pose).astype(float), 1, 255).astype(np.uint8)


def _light(world: World, pose: SE3, _: int) -> Image:
    return np.clip(0.35 * world.see(pose).astype(float) + 60.0, 1, 255).astype(np.uint8)


def _elsewhere(world: World, pose: SE3, _: int) -> Image:
    return world.see(pose, seed=world.seed + 1000)


def _kidnapped(world: World, pose: SE3, _: int) -> Image:
    return world.see(pose @ KIDNAPPED)


def _calibration(world: World, pose: SE3, _: int) -> Image:
    return world.see(pose, replace(CAMERA, fx=0.8 * CAMERA.fx, fy=0.8 * CAMERA.fy))


def _repeated(world: World, pose: SE3, _: int) -> Image:
    """Return a view of one third of the image three times, as of like windows in a row."""
    third = CAMERA.width // 3
    return np.ascontiguousarray(np.tile(world.see(pose)[:, third : 2 * third], (1, 3)))


def _nothing(world: World, pose: SE3, _: int) -> Image:
    return world.see(pose)


def _delayed(world: World, pose: SE3, index: int) -> Image:
    return world.see(_pose((index - 10) * PERIOD_NS * 1e-9))


# Light is no fault of the pose: it may be told, and must not be wrong.
FAULTS: dict[str, Fault] = {
    "covered": _covered,
    "70 % occluded": _occluded,
    "saturated": _saturated,
    "other light": _light,
    "another place": _elsewhere,
    "kidnapped": _kidnapped,
    "focal length 20 % off": _calibration,
    "images 0.5 s late": _delayed,
    "repeated texture": _repeated,
    "wrong start": _nothing,
}
WRONG_START_M, WRONG_START_RAD = 1.5, np.radians(30.0)  # an initial pose is off by as much at most, each axis


@dataclass
class Found:
    """What was counted."""

    undetected: dict[str, int] = field(default_factory=lambda: defaultdict(int))
    delays_s: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    injected: dict[str, int] = field(default_factory=lambda: defaultdict(int))
    false_alarms: int = 0
    num_nominal: int = 0
    num_trusted: int = 0
    distance_m: float = 0.0
    nees: list[float] = field(default_factory=list)


class Run:
    """One camera that drives and drives."""

    def __init__(self, world: World) -> None:
        self.world, self.found, self.index = world, Found(), 0
        self.localizer = Localizer(build(LocalizerParams, SETTINGS), world.map)
        self._T_odom, self._last = SE3.identity(), _pose(0.0)

    def step(self, fault: Fault | None = None) -> tuple[State, float, float, float]:
        """Localise the next image; return the state, and metres, radians and NEES of the pose, NaN without one."""
        self.index += 1
        pose = _pose(self.index * PERIOD_NS * 1e-9)
        moved = (self._last.inverse() @ pose).log()
        self._T_odom = self._T_odom @ SE3.exp(moved * (1.0 + ODOMETRY_NOISE * self.world.rng.normal(size=6)))
        self.found.distance_m += float(np.linalg.norm(moved[:3])) * (fault is None)
        self._last = pose
        image = self.world.see(pose) if fault is None else fault(self.world, pose, self.index)
        told = self.localizer.update(image, CAMERA, self.index * PERIOD_NS, self._T_odom)
        if told.T_map_camera is None or told.covariance is None:
            return told.status.state, np.nan, np.nan, np.nan
        truth = pose @ KIDNAPPED if fault is _kidnapped else pose
        xi = (told.T_map_camera.inverse() @ truth).log()
        metres, radians = told.T_map_camera.distance(truth)
        return told.status.state, float(metres), float(radians), float(xi @ np.linalg.solve(told.covariance, xi))

    def settle(self) -> None:
        """Drive on until the pose is trusted again."""
        if self.step()[0] is State.TRACKING:
            return
        self.localizer.reset()
        self.localizer.relocalize(self._last)
        for _ in range(CALM_IMAGES):
            if self.step()[0] is State.TRACKING:
                return

    def nominal(self, number: int) -> None:
        """Drive with nothing wrong."""
        bad = 0
        for _ in range(number):
            state, metres, radians, nees = self.step()
            self.found.num_nominal += 1
            self.found.num_trusted += state is State.TRACKING
            self.found.undetected["nothing"] += self._is_undetected(state, metres, radians)
            bad = 0 if state is State.TRACKING else bad + 1
            self.found.false_alarms += bad == round(LONG_S / (PERIOD_NS * 1e-9))
            if np.isfinite(nees):
                self.found.nees.append(nees)

    def inject(self, name: str) -> None:
        """Let something fail."""
        self.found.injected[name] += 1
        told_after = np.nan
        wrong = False
        if name == "wrong start":
            off = self.world.rng.uniform(-1.0, 1.0, 6) * np.repeat([WRONG_START_M, WRONG_START_RAD], 3)
            self.localizer.relocalize(self._last @ SE3.exp(off))
        for k in range(FAULT_IMAGES):
            state, metres, radians, _ = self.step(FAULTS[name])
            wrong |= self._is_undetected(state, metres, radians)
            if state is not State.TRACKING and np.isnan(told_after):
                told_after = k * PERIOD_NS * 1e-9
        self.found.undetected[name] += wrong
        if np.isfinite(told_after):
            self.found.delays_s[name].append(told_after)

    @staticmethod
    def _is_undetected(state: State, metres: float, radians: float) -> bool:
        return state is State.TRACKING and bool(metres > WRONG_M or radians > WRONG_RAD)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments; `--world-seed` is shared with other benchmarks."""
    parser.add_argument("--injections", type=int, default=504, metavar="N", help="failures in all (%(default)s)")
    parser.add_argument("--nominal-km", type=float, default=5.0, metavar="KM", help="without one (%(default)s)")


def run(options: argparse.Namespace) -> Report:
    """Inject failures, then drive without."""
    number, km = (len(FAULTS), 0.02) if options.quick else (options.injections, options.nominal_km)
    drive = Run(World(options.world_seed))
    for name in tqdm(list(_kinds(number)), "failures", leave=False, disable=None):
        drive.settle()
        drive.inject(name)
    drive.settle()
    drive.found.distance_m = 0.0
    with tqdm(total=round(1000 * km), desc="nominal", unit="m", leave=False, disable=None) as bar:
        while drive.found.distance_m < 1000 * km:
            drive.nominal(CALM_IMAGES)
            bar.update(round(drive.found.distance_m) - bar.n)
    drive.localizer.references.close()
    return _report(drive.found, options)


def _kinds(number: int) -> Iterator[str]:
    names = list(FAULTS)
    for k in range(number):
        yield names[k % len(names)]


def _report(found: Found, options: argparse.Namespace) -> Report:
    report = Report("localizer_faults", notes=[describe(options.threads), __doc__ or ""])
    rows: list[tuple[str, ...]] = []
    for name, count in found.injected.items():
        delays = found.delays_s[name]
        told = f"{np.median(delays):.2f}, {np.max(delays):.2f}" if delays else "-"
        rows.append((name, str(count), str(found.undetected[name]), str(len(delays)), told))
    columns = ("what fails for 2 s", "times", "undetected", "told", "delay s, median, max")
    report.tables.append(Table("Failures", columns, rows))
    total, km = sum(found.injected.values()), found.distance_m / 1000
    wrong = sum(found.undetected[name] for name in found.injected)
    mean = float(np.mean(found.nees)) if found.nees else float("nan")
    report.bounds = [
        Bound(f"undetected of {total} failures", 0.0, float(wrong), ""),
        Bound(
            f"wrong and TRACKING in {km:.2f} km without a failure", 0.0, float(found.undetected["nothing"]), "images"
        ),
        Bound("false DEGRADED longer than 1 s", 0.2, found.false_alarms / km, "per km"),
        Bound("TRACKING without a failure", 0.99, found.num_trusted / max(found.num_nominal, 1), "", is_minimum=True),
        Bound("mean NEES, 6 when honest", 12.0, mean, ""),
        Bound("mean NEES, 6 when honest, at least", 3.0, mean, "", is_minimum=True),
    ]
    return report
