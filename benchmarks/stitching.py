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

from benchmarks.machine import describe
from benchmarks.real_rigs import fisheye_rig, nuscenes, room
from benchmarks.report import Bound, Report, Table
from benchmarks.seam_light import light_step
from benchmarks.seams import Flow, column_shift, seam_flow
from benchmarks.sphere_pictures import write_cloud, write_sphere
from cycab_sim.params import SimParams
from cycab_sim.sensors.rigs import rig_place
from cycab_sim.simulator import Simulator
from sphere_mapping.acquisition.params import MatchParams, RectifyParams, StitchParams
from sphere_mapping.acquisition.range.epipolar import disparities_of_ranges, range_from_disparity
from sphere_mapping.acquisition.range.matching import match_columns
from sphere_mapping.acquisition.range.rectification import RigCorrection, rectify
from sphere_mapping.acquisition.stitching.stitcher import Stitcher
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.params import build
from sphere_nav.spheres.sphere import Sphere, continued

HELP = "spheres stitched from rigs: range against the truth, seams, spheres per second"
DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
Image = NDArray[np.uint8]
RATE_SPHERES = 8


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Say where the recordings are and which towns are seen."""
    parser.add_argument("--stitch-data", type=Path, default=DATA, metavar="DIR", help="recordings (%(default)s)")
    parser.add_argument(
        "--stitch-seeds", type=int, nargs="+", default=[5, 23], help="towns of the simulator (%(default)s)"
    )
    parser.add_argument("--stitch-width", type=int, default=2048, help="columns in the simulator (%(default)s)")
    parser.add_argument("--stitch-pictures", type=Path, metavar="DIR", help="write the spheres here")


def run(options: argparse.Namespace) -> Report:
    """Measure everything that there is."""
    seeds = options.stitch_seeds[:1] if options.quick else options.stitch_seeds
    bounds = [bound for seed in seeds for kind in ("vertical", "ring") for bound in _simulated(kind, seed, options)]
    rows: list[tuple[str, ...]] = []
    for folder, measure in (
        ("spherical_stereo/real_room", _room),
        ("fisheye_rig", _fisheye),
        ("surround/nuscenes", _nuscenes),
    ):
        path = options.stitch_data / folder
        if path.is_dir():
            bounds += measure(path, options)
        else:
            rows.append((folder, "skipped: not there"))
    tables = [Table("Recordings", ("recording", "state"), rows)] if rows else []
    return Report("stitching", tables, bounds, [describe(options.threads)])


def _simulated(kind: str, seed: int, options: argparse.Namespace) -> list[Bound]:
    """Compare spheres of a simulated rig with what is there."""
    width = options.stitch_width
    values = {"rig.kind": kind, "seed": seed, "rig.size": f"{width * 17 // 32},{width * 17 // 32}"}
    simulator = Simulator(build(SimParams, values))
    assert simulator.rig is not None
    images = {name: frame.image for name, frame in simulator.capture_rig().items()}
    stitcher = Stitcher(simulator.rig, build(StitchParams, {"width": width}), jobs=options.threads)
    sphere = stitcher.stitch(images).sphere
    T_base_sphere = rig_place(simulator.params.rig) @ stitcher.T_rig_sphere
    T_world_sphere = simulator.vehicle.state.T_world_base @ T_base_sphere
    levels, truth = simulator.render(stitcher.whole, T_world_sphere)
    name = f"{kind}, town {seed}"
    write_sphere(options.stitch_pictures, f"sim_{kind}_{seed}", sphere)
    bounds = _range_bounds(name, kind, sphere, truth)
    is_near = np.isfinite(truth) & (truth < 30)
    value = psnr(sphere.image, levels, is_near)
    bounds.append(Bound(f"{name}: image against the truth", 27.0, value, "dB", is_minimum=True))
    if kind == "vertical":
        bounds.append(_photo_consistency(name, simulator, stitcher, sphere, T_base_sphere))
    if seed == options.stitch_seeds[0]:
        rate, cpu = _rate(stitcher, images, options)
        bounds.append(Bound(f"{name}: spheres per second", 2.5, rate, "", is_minimum=True))
        bounds.append(Bound(f"{name}: CPU time of a sphere (two cores, 2.5 a second)", 0.8, cpu, "s"))
    return bounds


def _range_bounds(name: str, kind: str, sphere: Sphere, truth: NDArray[np.float32]) -> list[Bound]:
    near = np.isfinite(truth) & (truth < 30)
    found = near & is_measured(sphere)
    error = np.abs(sphere.range_m - truth) / truth
    at_ten = found & (np.abs(truth - 10) < 1)
    share = 0.85 if kind == "vertical" else 0.60
    return [
        Bound(f"{name}: measured within 30 m", share, float(found.sum() / near.sum()), "", is_minimum=True),
        Bound(f"{name}: median range error at 10 m", 0.02, float(np.median(error[at_ten])), ""),
        Bound(f"{name}: errors above 10 %", 0.02, float(np.mean(error[found] > 0.1)), ""),
    ]


def is_measured(sphere: Sphere) -> NDArray[np.bool_]:
    """Return which pixels (H, W) have a finite range."""
    return sphere.measured


def _rate(stitcher: Stitcher, images: Mapping[str, Image], options: argparse.Namespace) -> tuple[float, float]:
    """Return spheres per second, as many at a time as there are jobs, one thread each; and the CPU time of one in s."""
    one_by_one = Stitcher(stitcher.rig, stitcher.params, jobs=1)
    one_by_one.stitch(images)
    before, number = cv2.getNumThreads(), RATE_SPHERES // 2 if options.quick else RATE_SPHERES
    cv2.setNumThreads(1)
    with ThreadPoolExecutor(options.threads) as pool:
        begun, cpu = time.perf_counter(), time.process_time()
        list(pool.map(lambda _: one_by_one.stitch(images), range(number)))
        seconds, cpu = time.perf_counter() - begun, time.process_time() - cpu
    cv2.setNumThreads(before)
    return number / seconds, cpu / number


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
    rays = pixel_rays(before.camera)
    points = T_second_first.apply(rays * np.where(before.measured, before.range_m, np.nan)[..., None])
    pixels = np.nan_to_num(before.camera.project(points)[0], nan=-1.0).astype(np.float32)
    seen = cv2.remap(after.image, pixels[..., 0], pixels[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    there = cv2.remap(after.range_m, pixels[..., 0], pixels[..., 1], cv2.INTER_NEAREST)
    with np.errstate(invalid="ignore"):
        is_seen = before.measured & (np.abs(there / np.linalg.norm(points, axis=2) - 1) < 0.05)  # not occluded
    value = psnr(seen, before.image, is_seen)
    return Bound(f"{name}: sphere seen from its neighbour, 0.5 m on", 27.0, value, "dB", is_minimum=True)


def _room(folder: Path, options: argparse.Namespace) -> list[Bound]:
    top, bottom = room(folder)
    window, params = Spherical(top.shape[1], top.shape[0]), MatchParams()
    gray = [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in (top, bottom)]
    search, everywhere = disparities_of_ranges(window, 0.2, params), np.ones(gray[0].shape, np.bool_)
    disparity = match_columns(gray[0], gray[1], search, params, everywhere, options.threads)
    range_m, std_m = range_from_disparity(disparity, window, 0.2, params)
    measured = float(np.isfinite(range_m[window.height // 4 : 3 * window.height // 4]).mean())
    sphere = Sphere(top, range_m, window, 0, std_m)
    write_sphere(options.stitch_pictures, "real_room", sphere)
    write_cloud(options.stitch_pictures, "real_room", sphere)
    return [Bound("real_room: measured within 45 deg of the horizon", 0.75, measured, "", is_minimum=True)]


def _fisheye(folder: Path, options: argparse.Namespace) -> list[Bound]:
    """As the file has it, and with the rig corrected by its own images."""
    rig, images, masks = fisheye_rig(folder)
    params = build(StitchParams, {"width": 2048, "blend.distance_m": 4.0, "blend.num_passes": 3})
    stitcher = Stitcher(rig, params, masks, options.threads)
    bounds = _top_and_bottom("fisheye_rig, as its file says", stitcher, images, options)
    better = rectify(rig, stitcher.matches(images, RectifyParams()))
    name = f"fisheye_rig, corrected by {_most(better)} at most"
    stitcher = Stitcher(better.rig, params, masks, options.threads)
    sphere = stitcher.stitch(images).sphere
    write_sphere(options.stitch_pictures, "fisheye_rig", sphere)
    write_cloud(options.stitch_pictures, "fisheye_rig", sphere)
    middle = slice(sphere.image.shape[0] // 4, 3 * sphere.image.shape[0] // 4)
    measured = float(is_measured(sphere)[middle].mean())
    return [
        *bounds,
        *_top_and_bottom(name, stitcher, images, options),
        *_light("fisheye_rig", stitcher, images, "top", 0.03, 0.02),
        Bound("fisheye_rig: with range within 45 deg of the horizon", 0.5, measured, "", is_minimum=True),
    ]


def _top_and_bottom(
    name: str, stitcher: Stitcher, images: Mapping[str, Image], options: argparse.Namespace
) -> list[Bound]:
    range_m = stitcher.stitch(images).sphere.range_m
    shift = column_shift(stitcher, images, range_m)
    seams = [seam_flow(stitcher, images, level, range_m, 4.0) for level in ("top",)]
    return [
        Bound(f"{name}: column shift, median of {_of(shift)}", 0.5, shift.median, "px"),
        *(Bound(f"{name}: seams beyond 4 m, median of {_of(flow)}", 1.5, flow.median, "px") for flow in seams),
    ]


def _nuscenes(folder: Path, options: argparse.Namespace) -> list[Bound]:
    """As the file has it, and with the rig corrected by its own images; range by LiDAR."""
    rig, images, points_rig = nuscenes(folder)
    params = build(StitchParams, {"width": 2048, "range": "none", "blend.distance_m": 20.0})
    stitcher = Stitcher(rig, params, jobs=options.threads)
    better = rectify(rig, stitcher.matches(images, RectifyParams(), points_rig))
    corrected = Stitcher(better.rig, params, jobs=options.threads)
    bounds = []
    for name, one in (("as its file says", stitcher), (f"corrected by {_most(better)} at most", corrected)):
        sphere = one.stitch(images, 0, points_rig).sphere
        flow = seam_flow(one, images, "", sphere.range_m, 10.0)
        what = f"nuscenes, {name}: seams beyond 10 m, median of {_of(flow)}"
        bounds.append(Bound(what, 1.5, flow.median, "px"))
    bounds += _light("nuscenes", corrected, images, "", 0.12, 0.10)
    write_sphere(options.stitch_pictures, "nuscenes", sphere)
    ratio = edge_ratio(cv2.cvtColor(sphere.image, cv2.COLOR_RGB2GRAY), sphere)
    what = "nuscenes: image gradient at range edges over elsewhere"
    return [*bounds, Bound(what, 1.2, ratio, "x", is_minimum=True)]


def _light(
    name: str, stitcher: Stitcher, images: Mapping[str, Image], level: str, median: float, worst: float
) -> list[Bound]:
    """Return the steps of light across all seams, once made equal; what they were is told."""
    before = light_step(stitcher, images, level)
    after = light_step(stitcher, stitcher.equalize(images)[0], level)
    seams = f"{after.num_seams} seam{'s' * (after.num_seams > 1)}, as recorded"
    return [
        Bound(f"{name}: light across {seams} {before.median:.3f}, median of all pixels", median, after.median, ""),
        Bound(f"{name}: light across {seams} {before.worst:.3f}, worst seam's median", worst, after.worst, ""),
        Bound(f"{name}: colours apart at {seams} {before.color:.3f}, worst seam", 0.06, after.color, ""),
    ]


def _most(better: RigCorrection) -> str:
    return f"{max(better.angle_deg.values()):.2f} deg"


def _of(flow: Flow) -> str:
    return f"{flow.num_followed} of {flow.num_corners} corners"


def edge_ratio(gray: Image, sphere: Sphere) -> float:
    """Return the mean image gradient where the range jumps, over that where it does not."""
    gradient = np.hypot(cv2.Sobel(gray, cv2.CV_32F, 1, 0), cv2.Sobel(gray, cv2.CV_32F, 0, 1))
    known = sphere.measured
    whole = continued(np.nan_to_num(sphere.range_m, nan=0.0), known)
    jump = np.abs(np.log(np.maximum(whole, 0.1)) - np.log(np.maximum(np.roll(whole, 1, axis=1), 0.1))) > 0.2
    near = cv2.dilate(known.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return float(gradient[jump & near].mean() / gradient[~jump & near].mean())


def psnr(a: Image, b: Image, keep: NDArray[np.bool_]) -> float:
    """Return the peak signal-to-noise ratio in dB of the pixels to keep."""
    return float(10 * np.log10(255**2 / np.mean(np.square(a[keep].astype(np.float64) - b[keep]))))
