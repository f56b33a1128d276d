"""Spheres from six cameras: the simulator's two rigs against the truth, and real recordings."""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.mapping.rigs import fisheye_rig, nuscenes, room
from benchmarks.mapping.seams import light_step, seam_flow
from benchmarks.report import Bound, Report
from cycab_sim.params import SimParams
from cycab_sim.sensors.rigs import rig_place
from cycab_sim.simulator import Simulator
from sphere_mapping.acquisition.params import MatchParams, RectifyParams, StitchParams
from sphere_mapping.acquisition.range.epipolar import disparities_of_ranges, range_from_disparity
from sphere_mapping.acquisition.range.matching import match_columns
from sphere_mapping.acquisition.range.rectification import rectify
from sphere_mapping.acquisition.stitching.stitcher import Stitcher
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.params import build
from sphere_nav.spheres.sphere import Sphere

HELP = "spheres stitched from rigs: range against the truth, seams, spheres per second"
RATE_SPHERES = 8
Image = NDArray[np.uint8]
Images = Mapping[str, Image]


def run(options: argparse.Namespace) -> Report:
    """Measure everything that there is."""
    report = Report("stitching")
    seeds = [options.seed] if options.size == "quick" else [options.seed, options.seed + 18]
    for number, seed in enumerate(seeds):
        for kind in ("vertical", "ring"):
            report.bounds += _simulated(kind, seed, options, is_timed=number == 0)
    for folder, measure in (
        ("spherical_stereo/real_room", _room),
        ("fisheye_rig", _fisheye),
        ("surround/nuscenes", _nuscenes),
    ):
        if (options.data / folder).is_dir():
            report.bounds += measure(options.data / folder, options)
        else:
            report.notes.append(f"{folder}: skipped, not in {options.data}")
    return report


def _width(options: argparse.Namespace) -> int:
    return int(options.width or (1024 if options.size == "quick" else 2048))


def _simulated(kind: str, seed: int, options: argparse.Namespace, *, is_timed: bool) -> list[Bound]:
    """Compare spheres of a simulated rig with what is there."""
    width = _width(options)
    values = {"rig.kind": kind, "seed": seed, "rig.size": f"{width * 17 // 32},{width * 17 // 32}"}
    simulator = Simulator(build(SimParams, values))
    assert simulator.rig is not None
    images = {name: frame.image for name, frame in simulator.capture_rig().items()}
    stitcher = Stitcher(simulator.rig, build(StitchParams, {"width": width}), jobs=options.threads)
    sphere = stitcher.stitch(images).sphere
    T_base_sphere = rig_place(simulator.params.rig) @ stitcher.T_rig_sphere
    levels, truth = simulator.render(stitcher.whole, simulator.vehicle.state.T_world_base @ T_base_sphere)
    name, near = f"{kind}, town {seed}", np.isfinite(truth) & (truth < 30)
    found = near & sphere.measured
    with np.errstate(invalid="ignore"):
        error = np.abs(sphere.range_m - truth) / truth
    share = 0.85 if kind == "vertical" else 0.60
    bounds = [
        Bound(f"{name}: measured within 30 m", share, float(found.sum() / near.sum()), "", is_minimum=True),
        Bound(f"{name}: median error at 10 m", 0.02, float(np.median(error[found & (np.abs(truth - 10) < 1)])), ""),
        Bound(f"{name}: errors above 10 %", 0.02, float(np.mean(error[found] > 0.1)), ""),
        Bound(f"{name}: image against the truth", 27.0, psnr(sphere.image, levels, near), "dB", is_minimum=True),
    ]
    if kind == "vertical":
        bounds.append(_photo_consistency(name, simulator, stitcher, sphere, T_base_sphere))
    return bounds + (_rate(name, stitcher, images, options) if is_timed else [])


def _rate(name: str, stitcher: Stitcher, images: Images, options: argparse.Namespace) -> list[Bound]:
    """Bound spheres per second, as many at a time as there are jobs, one thread each; and the CPU time of one."""
    one_by_one = Stitcher(stitcher.rig, stitcher.params, jobs=1)
    one_by_one.stitch(images)
    before, number = cv2.getNumThreads(), RATE_SPHERES // 2 if options.size == "quick" else RATE_SPHERES
    cv2.setNumThreads(1)
    with ThreadPoolExecutor(options.threads) as pool:
        begun, cpu = time.perf_counter(), time.process_time()
        list(pool.map(lambda _: one_by_one.stitch(images), range(number)))
        seconds, cpu = time.perf_counter() - begun, time.process_time() - cpu
    cv2.setNumThreads(before)
    what = f"{name}, {stitcher.whole.width} px"
    return [
        Bound(f"{what}: spheres per second", 2.5, number / seconds, "", is_minimum=True),
        Bound(f"{what}: CPU time of a sphere (two cores, 2.5 a second)", 0.8, cpu / number, "s"),
    ]


def _photo_consistency(
    name: str, simulator: Simulator, stitcher: Stitcher, before: Sphere, T_base_sphere: SE3
) -> Bound:
    """Drive on, take the next sphere, and see it from the first by the first one's range."""
    T_world_first = simulator.vehicle.state.T_world_base @ T_base_sphere
    x, y, _ = simulator.vehicle.state.T_world_base.translation
    yaw = float(simulator.vehicle.state.T_world_base.yaw)
    simulator.teleport(float(x + 0.5 * np.cos(yaw)), float(y + 0.5 * np.sin(yaw)), yaw)
    after = stitcher.stitch({name: frame.image for name, frame in simulator.capture_rig().items()}).sphere
    T_second_first = (simulator.vehicle.state.T_world_base @ T_base_sphere).inverse() @ T_world_first
    points = T_second_first.apply(
        pixel_rays(before.camera) * np.where(before.measured, before.range_m, np.nan)[..., None]
    )
    u, v = np.moveaxis(np.nan_to_num(before.camera.project(points)[0], nan=-1.0).astype(np.float32), -1, 0)
    seen = cv2.remap(after.image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    there = cv2.remap(after.range_m, u, v, cv2.INTER_NEAREST)
    with np.errstate(invalid="ignore"):
        is_seen = before.measured & (np.abs(there / np.linalg.norm(points, axis=2) - 1) < 0.05)  # not occluded
    value = psnr(seen, before.image, is_seen)
    return Bound(f"{name}: sphere seen from its neighbour, 0.5 m on", 27.0, value, "dB", is_minimum=True)


def _room(folder: Path, options: argparse.Namespace) -> list[Bound]:
    top, bottom = (cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in room(folder))
    window, params = Spherical(top.shape[1], top.shape[0]), MatchParams()
    search, everywhere = disparities_of_ranges(window, 0.2, params), np.ones(top.shape, np.bool_)
    disparity = match_columns(top, bottom, search, params, everywhere, options.threads)
    range_m, _ = range_from_disparity(disparity, window, 0.2, params)
    measured = float(np.isfinite(_level(range_m)).mean())
    return [Bound("real_room: measured within 45 deg of the horizon", 0.75, measured, "", is_minimum=True)]


def _fisheye(folder: Path, options: argparse.Namespace) -> list[Bound]:
    """As the file has it, and with the rig corrected by its own images."""
    rig, images, masks = fisheye_rig(folder)
    params = build(StitchParams, {"width": _width(options), "blend.distance_m": 4.0, "blend.num_passes": 3})
    stitcher = Stitcher(rig, params, masks, options.threads)
    better = rectify(rig, stitcher.matches(images, RectifyParams()))
    corrected = Stitcher(better.rig, params, masks, options.threads)
    bounds = []
    for how, one in (("as its file says", stitcher), (f"corrected by {_most(better.angle_deg)}", corrected)):
        sphere = one.stitch(images).sphere
        flow = seam_flow(one, images, "top", sphere.range_m, 4.0)
        what = f"fisheye_rig, {how}: seams beyond 4 m, {flow.num_followed} corners"
        bounds.append(Bound(what, 1.5, flow.median, "px"))
    bounds += _light("fisheye_rig", corrected, images, "top", (0.03, 0.02))
    measured = float(_level(sphere.measured).mean())
    return [*bounds, Bound("fisheye_rig: measured within 45 deg of level", 0.5, measured, "", is_minimum=True)]


def _nuscenes(folder: Path, options: argparse.Namespace) -> list[Bound]:
    """As the file has it, and with the rig corrected by its own images; range by LiDAR."""
    rig, images, points_rig = nuscenes(folder)
    params = build(StitchParams, {"width": _width(options), "range": "none", "blend.distance_m": 20.0})
    stitcher = Stitcher(rig, params, jobs=options.threads)
    better = rectify(rig, stitcher.matches(images, RectifyParams(), points_rig))
    corrected = Stitcher(better.rig, params, jobs=options.threads)
    bounds = []
    for how, one in (("as its file says", stitcher), (f"corrected by {_most(better.angle_deg)}", corrected)):
        flow = seam_flow(one, images, "", one.stitch(images, 0, points_rig).sphere.range_m, 10.0)
        bounds.append(Bound(f"nuscenes, {how}: seams beyond 10 m, {flow.num_followed} corners", 1.5, flow.median, "px"))
    return bounds + _light("nuscenes", corrected, images, "", (0.12, 0.10))


def _light(name: str, stitcher: Stitcher, images: Images, level: str, limits: tuple[float, float]) -> list[Bound]:
    """Bound the steps of light across all seams, once made equal; what they were is told."""
    before, after = (light_step(stitcher, these, level) for these in (images, stitcher.equalize(images)[0]))
    return [
        Bound(f"{name}: light across the seams, {what}, as recorded {was:.3f}", limit, now, "")
        for what, limit, was, now in zip(("median", "worst seam"), limits, before, after, strict=True)
    ]


def _level(plane: NDArray) -> NDArray:
    """Return the rows within 45 degrees of the horizon."""
    return plane[plane.shape[0] // 4 : 3 * plane.shape[0] // 4]


def _most(angles_deg: Mapping[str, float]) -> str:
    return f"{max(angles_deg.values()):.2f} deg at most"


def psnr(a: Image, b: Image, keep: NDArray[np.bool_]) -> float:
    """Return the peak signal-to-noise ratio in dB of the pixels to keep."""
    return float(10 * np.log10(255**2 / np.mean(np.square(a[keep].astype(np.float64) - b[keep]))))
