"""Range by class of surface as one instant measures it, and with the spheres before it: the drive's parallax."""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import describe
from benchmarks.range_classes import BOUNDED, CLASSES, FAR_M, NEAR_M, classify
from benchmarks.range_honesty import Honesty, honesty
from benchmarks.range_worlds import BARE, REPETITIVE, UNLIT, make_scene
from benchmarks.report import Bound, Report, Table
from cycab_sim.params import CameraRigParams, ImagingParams, SimParams
from cycab_sim.rendering.renderer import Renderer
from cycab_sim.sensors.imaging import expose
from cycab_sim.sensors.rigs import rig_mounts, rig_place
from cycab_sim.simulator import Simulator
from sphere_mapping.acquisition.params import MatchParams, StitchParams
from sphere_mapping.acquisition.range.drive import PlacedSphere, range_by_drive
from sphere_mapping.acquisition.range.fusion import Ranged, fill_unknown
from sphere_mapping.acquisition.stitching.stitcher import Stitcher
from sphere_nav.geometry import SE3, Rig
from sphere_nav.params import build
from sphere_nav.spheres.sphere import Sphere

HELP = "range by class of surface, by one instant and with the two spheres before it (drive_range)"
STEPS_M = {"town": 0.5, "room": 0.3}  # between the instants
TURN = SE3.exp([0.0, 0.03, 0.0, 0.0, 0.0, 0.05])  # of the vehicle from one instant to the next
MOTION_STD = np.repeat([0.003, 0.0005], 3)  # m, rad: of what registration says, added and told
VIEW_DEG = 190.0
LEAST_BARE = 0.8  # of bare walls in rooms, measured right
Plane = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Driven:
    """The last sphere of a short drive, those before it as registration places them, and what is truly there."""

    sphere: Sphere
    earlier: list[PlacedSphere]
    truth: Plane
    classes: NDArray[np.int8]


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Say which worlds are seen, and how; town 71 and room 1 are what the constants were chosen on."""
    parser.add_argument("--parallax-towns", type=int, nargs="*", default=[72, 73], help="seeds (%(default)s)")
    parser.add_argument("--parallax-rooms", type=int, nargs="*", default=[19, 20], help="seeds (%(default)s)")
    parser.add_argument("--parallax-rigs", nargs="+", default=["ring", "vertical"], help="rigs (%(default)s)")
    parser.add_argument("--parallax-width", type=int, default=1024, help="columns of the sphere (%(default)s)")


def run(options: argparse.Namespace) -> Report:
    """Measure worlds by each rig."""
    report = Report("range_drive", [], [], [describe(options.threads)])
    for kind in options.parallax_rigs:
        for place, seeds in (("town", options.parallax_towns), ("room", options.parallax_rooms)):
            counts: list[NDArray[Any]] = []
            wrong_far, cpu_s = [], []
            for seed in seeds[:1] if options.quick else seeds:
                driven = (_town if place == "town" else _room)(kind, seed, options.parallax_width)
                begun = time.process_time()
                more = range_by_drive(driven.sphere, driven.earlier, MatchParams())
                cpu_s.append(time.process_time() - begun)
                of_three = _count(driven, more)
                counts.append(np.array(of_three[0], dtype=object))
                wrong_far.append(of_three[1])
            if counts:
                _tell(report, f"{kind}, {place}s", np.sum(counts, axis=0), np.sum(wrong_far, axis=0), cpu_s)
    return report


def _count(driven: Driven, more: Ranged) -> tuple[list[list[Honesty]], list[int]]:
    """Return by class what the instant measured, what it has with the drive, what is new; wrong of the far, and far."""
    assert driven.sphere.range_std_m is not None
    both = driven.sphere.range_m.copy(), driven.sphere.range_std_m.copy()
    fill_unknown(both, more)
    is_near = np.isfinite(driven.truth) & (driven.truth < NEAR_M)
    before = (driven.sphere.range_m, driven.sphere.range_std_m)
    counts = [
        [honesty(*ranged, driven.truth, is_near & (driven.classes == k)) for ranged in (before, both, more)]
        for k in range(len(CLASSES) - 1)
    ]
    is_far = driven.classes == len(CLASSES) - 1
    wrong = [int((is_far & (ranged[0] + 3 * ranged[1] < FAR_M)).sum()) for ranged in (before, both)]
    return counts, [*wrong, int(is_far.sum())]


def _tell(report: Report, name: str, counts: NDArray, far: NDArray, cpu_s: list[float]) -> None:
    rows = []
    for label, (before, both, more) in zip(CLASSES, counts, strict=False):
        there, n = max(before.there, 1), max(more.n, 1)
        shares = (before.within_10_percent / there, both.within_10_percent / there, more.n / there)
        wrong = (more.beyond_3_sigma / n, more.beyond_10_percent / n)
        together = (both.beyond_3_sigma / max(both.n, 1) - before.beyond_3_sigma / max(before.n, 1),)
        rows.append((label, *(f"{100 * share:.2f}" for share in (*shares, *wrong, *together))))
        if label in BOUNDED and more.n:
            report.bounds.append(Bound(f"{name}, {label}: new, beyond 3 sigma", 0.02, wrong[0], ""))
            report.bounds.append(Bound(f"{name}, {label}: new, beyond 10 %", 0.03, wrong[1], ""))
        if label == "bare" and name.endswith("rooms"):
            report.bounds.append(
                Bound(f"{name}, bare: measured right with the drive", LEAST_BARE, shares[1], "", is_minimum=True)
            )
    if far[2]:
        report.bounds.append(Bound(f"{name}, far: wrong with the drive", 0.005, float(far[1] / far[2]), ""))
        report.notes.append(f"{name}, far: wrong before {far[0] / far[2]:.2%}, with the drive {far[1] / far[2]:.2%}")
    report.notes.append(f"{name}: {float(np.median(cpu_s)):.2g} s of CPU for a key sphere")
    columns = (
        "surface",
        "right %",
        "with the drive %",
        "new %",
        "of new beyond 3 sigma %",
        "beyond 10 % %",
        "more wrong",
    )
    report.tables.append(Table(f"Seen by a {name}", columns, rows))


def _town(kind: str, seed: int, width: int) -> Driven:
    side = width * 17 // 32
    values = {"rig.kind": kind, "seed": seed, "rig.view_deg": VIEW_DEG, "rig.size": f"{side},{side}"}
    simulator = Simulator(build(SimParams, values))
    assert simulator.rig is not None
    T_world_rig = simulator.vehicle.state.T_world_base @ rig_place(simulator.params.rig)
    return _drive(simulator.rig, simulator.params.rig, simulator.renderer, T_world_rig, "town", seed, width)


def _room(kind: str, seed: int, width: int) -> Driven:
    scene = make_scene(seed, kind, width, {"view_deg": VIEW_DEG})
    params = build(
        CameraRigParams, {"kind": kind, "size": f"{width * 17 // 32},{width * 17 // 32}", "view_deg": VIEW_DEG}
    )
    driven = _drive(scene.rig, params, scene.renderer, scene.T_world_rig, "room", seed, width)
    stitcher = Stitcher(scene.rig, build(StitchParams, {"width": width, "range": "none"}))
    _, panels = scene.truth(stitcher.whole, stitcher.T_rig_sphere)
    is_surface = driven.classes < CLASSES.index("edge")
    for panel, name in ((BARE, "bare"), (UNLIT, "unlit"), (REPETITIVE, "repetitive")):
        driven.classes[is_surface & (panels == panel)] = CLASSES.index(name)
    return driven


def _drive(
    rig: Rig, params: CameraRigParams, renderer: Renderer, T_world_rig: SE3, place: str, seed: int, width: int
) -> Driven:
    """Stitch the last instant and the two before it, as the rig came to where it is."""
    stitcher, rng = Stitcher(rig, build(StitchParams, {"width": width})), np.random.default_rng([seed, 73])
    spheres, T_last_now, poses = [], SE3.identity(), []
    for instant in range(3):
        images = {}
        for number, mount in enumerate(rig_mounts(params, ImagingParams(), rig)):
            levels, _ = renderer.render(mount.camera, T_world_rig @ T_last_now @ rig.camera(mount.name).T_rig_camera)
            images[mount.name] = expose(levels, mount.noise, mount.shot_noise, (seed + 100 * instant, 72, number))
        spheres.append(stitcher.stitch(images, instant).sphere)
        poses.append(stitcher.T_rig_sphere.inverse() @ T_last_now @ stitcher.T_rig_sphere)
        T_last_now = T_last_now @ SE3.exp([-STEPS_M[place], 0, 0, 0, 0, 0]) @ TURN
    covariance = np.diag(MOTION_STD**2)
    earlier = [
        PlacedSphere(sphere, T @ SE3.exp(MOTION_STD * rng.normal(size=6)), covariance)
        for sphere, T in zip(spheres[1:], poses[1:], strict=True)
    ]
    T_world_sphere = T_world_rig @ stitcher.T_rig_sphere
    levels, truth = renderer.render(stitcher.whole, T_world_sphere)
    return Driven(spheres[0], earlier, truth, classify(levels, truth, stitcher.whole, T_world_sphere))
