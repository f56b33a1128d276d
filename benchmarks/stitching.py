"""Spheres from six cameras: the simulator's two rigs against the truth, and real recordings."""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from itertools import combinations
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import describe
from benchmarks.real_rigs import fisheye_rig, nuscenes, room
from benchmarks.report import Bound, Report, Table
from cycab_sim.params import SimParams
from cycab_sim.rigs import rig_place
from cycab_sim.simulator import Simulator
from sphere_geometry import SE3, Spherical
from sphere_geometry.camera import pixel_grid
from sphere_mapping.sphere import Sphere, continued
from sphere_mapping.stitching.blending import warped
from sphere_mapping.stitching.epipolar import range_from_disparity
from sphere_mapping.stitching.matching import match_columns
from sphere_mapping.stitching.params import StitchParams
from sphere_mapping.stitching.stitcher import Stitcher
from sphere_mapping.stitching.views import View
from typed_params import build

HELP = "spheres stitched from rigs: range against the truth, seams, spheres per second"
DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
UNCHECKED = {
    "match.uniqueness": 0,
    "match.max_left_right_px": -1,
    "match.speckle_size": 0,
    "match.max_relative_std": 9.0,
    "match.edge_px": 0,
}
Image = NDArray[np.uint8]
RATE_SPHERES = 8
DISTANT_M = 8.0  # what is nearer shows parallax that one centre cannot hide


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Say where the recordings are and which town is seen."""
    parser.add_argument("--stitch-data", type=Path, default=DATA, metavar="DIR", help="recordings (%(default)s)")
    parser.add_argument("--stitch-seed", type=int, default=5, help="town of the simulator (%(default)s)")
    parser.add_argument("--stitch-width", type=int, default=2048, help="columns in the simulator (%(default)s)")
    parser.add_argument("--stitch-pictures", type=Path, metavar="DIR", help="write the spheres here")


def run(options: argparse.Namespace) -> Report:
    """Measure everything that there is."""
    bounds = [bound for kind in ("vertical", "ring") for bound in _simulated(kind, options)]
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


def _simulated(kind: str, options: argparse.Namespace) -> list[Bound]:
    """Compare spheres of a simulated rig with what is there."""
    width = options.stitch_width
    values = {
        "rig.kind": kind,
        "seed": options.stitch_seed,
        "rig.width": width * 17 // 32,
        "rig.height": width * 17 // 32,
    }
    simulator = Simulator(build(SimParams, values))
    assert simulator.rig is not None
    images = {name: frame.image for name, frame in simulator.capture_rig().items()}
    stitcher = Stitcher(simulator.rig, build(StitchParams, {"width": width}), jobs=options.threads)
    sphere = stitcher.stitch(images).sphere
    T_base_sphere = rig_place(simulator.params.rig) @ stitcher.T_rig_sphere
    T_world_sphere = simulator.vehicle.state.T_world_base @ T_base_sphere
    levels, truth = simulator.render(stitcher.whole, T_world_sphere)
    unchecked = Stitcher(simulator.rig, build(StitchParams, {"width": width} | UNCHECKED)).stitch(images).sphere
    _write(options, f"sim_{kind}", sphere)
    near = np.isfinite(truth) & (truth < 30)
    found, before = near & sphere.measured, near & unchecked.measured
    error, error_before = (np.abs(one.range_m - truth) / truth for one in (sphere, unchecked))
    at_ten = found & (np.abs(truth - 10) < 1)
    share = 0.85 if kind == "vertical" else 0.60
    name = f"simulator, {kind}"
    bounds = [
        Bound(f"{name}: measured within 30 m", share, float(found.sum() / near.sum()), "", is_minimum=True),
        Bound(f"{name}: median range error at 10 m", 0.02, float(np.median(error[at_ten])), ""),
        Bound(f"{name}: errors above 10 % before the check", 0.05, float(np.mean(error_before[before] > 0.1)), ""),
        Bound(f"{name}: errors above 10 % after the check", 0.02, float(np.mean(error[found] > 0.1)), ""),
        Bound(f"{name}: image against the truth", 27.0, psnr(sphere.image, levels, near), "dB", is_minimum=True),
    ]
    if kind == "vertical":
        bounds.append(Bound("spheres per second", 2.5, _rate(stitcher, images, options.threads), "", is_minimum=True))
        bounds.append(_photo_consistency(simulator, stitcher, sphere, T_base_sphere))
    return bounds


def _rate(stitcher: Stitcher, images: Mapping[str, Image], jobs: int) -> float:
    """Return spheres per second, as many at a time as there are jobs, one thread each."""
    one_by_one = Stitcher(stitcher.rig, stitcher.params, jobs=1)
    one_by_one.stitch(images)
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    with ThreadPoolExecutor(jobs) as pool:
        begun = time.perf_counter()
        list(pool.map(lambda _: one_by_one.stitch(images), range(RATE_SPHERES)))
        seconds = time.perf_counter() - begun
    cv2.setNumThreads(before)
    return RATE_SPHERES / seconds


def _photo_consistency(simulator: Simulator, stitcher: Stitcher, before: Sphere, T_base_sphere: SE3) -> Bound:
    """Drive on, take the next sphere, and see it from the first by the first one's range."""
    T_world_first = simulator.vehicle.state.T_world_base @ T_base_sphere
    x, y, _ = simulator.vehicle.state.T_world_base.translation
    yaw = float(simulator.vehicle.state.T_world_base.yaw)
    simulator.teleport(float(x + 0.5 * np.cos(yaw)), float(y + 0.5 * np.sin(yaw)), yaw)
    after = stitcher.stitch({name: frame.image for name, frame in simulator.capture_rig().items()}).sphere
    T_second_first = (simulator.vehicle.state.T_world_base @ T_base_sphere).inverse() @ T_world_first
    rays = before.camera.unproject(pixel_grid(before.camera))
    points = T_second_first.apply(rays * np.where(before.measured, before.range_m, np.nan)[..., None])
    pixels = np.nan_to_num(before.camera.project(points)[0], nan=-1.0).astype(np.float32)
    seen = cv2.remap(after.image, pixels[..., 0], pixels[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    there = cv2.remap(after.range_m, pixels[..., 0], pixels[..., 1], cv2.INTER_NEAREST)
    with np.errstate(invalid="ignore"):
        is_seen = before.measured & (np.abs(there / np.linalg.norm(points, axis=2) - 1) < 0.05)  # not occluded
    value = psnr(seen, before.image, is_seen)
    return Bound("sphere seen from its neighbour, 0.5 m on", 27.0, value, "dB", is_minimum=True)


def _room(folder: Path, options: argparse.Namespace) -> list[Bound]:
    top, bottom = room(folder)
    window, params = Spherical(top.shape[1], top.shape[0]), build(StitchParams, {"match.max_disparity_deg": 25.0}).match
    grey = [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in (top, bottom)]
    disparity = match_columns(grey[0], grey[1], window, params, np.ones(grey[0].shape, np.bool_), options.threads)
    range_m, _ = range_from_disparity(disparity, window, 0.2, params)
    _write(options, "real_room", Sphere(top, range_m, window))
    middle = slice(window.height // 4, 3 * window.height // 4)
    share = float(np.isfinite(range_m[middle]).mean())
    return [Bound("real_room: with range within 45 deg of the horizon", 0.75, share, "", is_minimum=True)]


def _fisheye(folder: Path, options: argparse.Namespace) -> list[Bound]:
    rig, images, masks = fisheye_rig(folder)
    stitcher = Stitcher(
        rig,
        build(StitchParams, {"width": 2048, "blend.distance_m": 4.0, "blend.num_passes": 3}),
        masks,
        options.threads,
    )
    found = stitcher.stitch(images)
    _write(options, "fisheye_rig", found.sphere)
    top = stitcher.top_and_bottom(images, found.sphere.range_m)[0]
    assert found.bottom is not None
    if options.stitch_pictures:
        cv2.imwrite(str(options.stitch_pictures / "fisheye_rig_bottom.png"), found.bottom)
    flow = flow_between(top, found.bottom)
    middle = slice(top.shape[0] // 4, 3 * top.shape[0] // 4)
    is_sharp = (np.abs(cv2.Sobel(top, cv2.CV_32F, 1, 0)) > 60)[middle] & (top > 0)[middle] & (found.bottom > 0)[middle]
    shift = float(np.median(np.abs(flow[middle][is_sharp][:, 0])))
    measured = float(np.isfinite(found.sphere.range_m[middle]).mean())
    return [
        Bound("fisheye_rig: column shift of top and bottom, median", 0.5, shift, "px"),
        Bound(
            "fisheye_rig: seams, median flow between views", 1.5, seam_flow(stitcher, images, "top", found.sphere), "px"
        ),
        Bound("fisheye_rig: with range within 45 deg of the horizon", 0.5, measured, "", is_minimum=True),
    ]


def _nuscenes(folder: Path, options: argparse.Namespace) -> list[Bound]:
    rig, images, points_rig = nuscenes(folder)
    stitcher = Stitcher(rig, build(StitchParams, {"width": 2048, "range": "none", "blend.distance_m": 20.0}), jobs=2)
    found = stitcher.stitch(images, 0, points_rig)
    _write(options, "nuscenes", found.sphere)
    grey = cv2.cvtColor(found.sphere.image, cv2.COLOR_RGB2GRAY)
    return [
        Bound("nuscenes: seams, median flow between views", 1.5, seam_flow(stitcher, images, "", found.sphere), "px"),
        Bound(
            "nuscenes: image gradient at range edges over elsewhere",
            1.2,
            edge_ratio(grey, found.sphere),
            "x",
            is_minimum=True,
        ),
    ]


def seam_flow(stitcher: Stitcher, images: Mapping[str, Image], level: str, sphere: Sphere) -> float:
    """Return the median length in px of the flow between two cameras' views of distant detail whose range is known."""
    layout = stitcher.layout(level, tuple(images))
    known = ~np.isnan(sphere.range_m)
    inverse = continued((1.0 / sphere.range_m).astype(np.float32), known)
    distant = known & (sphere.range_m > DISTANT_M)
    lengths = []
    for a, b in combinations(layout.views, 2):
        planes = [_on_sphere(view, images, layout.whole, inverse) for view in (a, b)]
        both = planes[0][1] & planes[1][1]
        lengths += _flow_in_strips([plane[0] for plane in planes], both, distant)
    return float(np.median(np.concatenate(lengths))) if lengths else float("nan")


def _on_sphere(view: View, images: Mapping[str, Image], whole: Spherical, inverse: NDArray) -> tuple[Image, NDArray]:
    """Return a view's grey levels (H, W) and where it sees."""
    image = images[view.name]
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) if image.ndim == 3 else image
    plane, seen = np.zeros((whole.height, whole.width), np.uint8), np.zeros((whole.height, whole.width), np.bool_)
    columns = np.arange(view.block.column, view.block.column + min(view.block.width, whole.width)) % whole.width
    rows = slice(view.block.row, view.block.row + view.block.height)
    plane[rows, columns] = warped(view, grey, inverse)[:, : columns.size]
    rays = whole.unproject(pixel_grid(whole))[rows][:, columns]
    seen[rows, columns] = view.seat.look(rays * 20.0)[2] > 0.02
    return plane, seen


def _flow_in_strips(planes: list[Image], both: NDArray[np.bool_], distant: NDArray[np.bool_]) -> list[NDArray]:
    """Return the flow's lengths, a strip at a time: what is not seen by both must not be matched."""
    inner = (cv2.erode(both.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0) & distant
    sharp = np.hypot(cv2.Sobel(planes[0], cv2.CV_32F, 1, 0), cv2.Sobel(planes[0], cv2.CV_32F, 0, 1)) > 60
    found = []
    for first in range(0, both.shape[1], 64):
        part = slice(first, first + 64)
        chosen = (inner & sharp)[:, part]
        if np.count_nonzero(chosen) > 50:
            pair = [cv2.equalizeHist(np.where(both[:, part], plane[:, part], 0).astype(np.uint8)) for plane in planes]
            found.append(np.linalg.norm(flow_between(*pair)[chosen], axis=1))
    return found


def flow_between(first: Image, second: Image) -> NDArray[np.float32]:
    """Return the dense flow (H, W, 2) in px."""
    finder = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    return finder.calc(np.ascontiguousarray(first), np.ascontiguousarray(second), None)


def edge_ratio(grey: Image, sphere: Sphere) -> float:
    """Return the mean image gradient where the range jumps, over that where it does not."""
    gradient = np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1))
    known = sphere.measured
    whole = continued(np.nan_to_num(sphere.range_m, nan=0.0), known)
    jump = np.abs(np.log(np.maximum(whole, 0.1)) - np.log(np.maximum(np.roll(whole, 1, axis=1), 0.1))) > 0.2
    near = cv2.dilate(known.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return float(gradient[jump & near].mean() / gradient[~jump & near].mean())


def psnr(a: Image, b: Image, keep: NDArray[np.bool_]) -> float:
    """Return the peak signal-to-noise ratio in dB of the pixels to keep."""
    return float(10 * np.log10(255**2 / np.mean(np.square(a[keep].astype(np.float64) - b[keep]))))


def _write(options: argparse.Namespace, name: str, sphere: Sphere) -> None:
    if not options.stitch_pictures:
        return
    options.stitch_pictures.mkdir(parents=True, exist_ok=True)
    image = sphere.image[:, :, ::-1] if sphere.image.ndim == 3 else sphere.image
    cv2.imwrite(str(options.stitch_pictures / f"{name}.png"), image)
    shade = np.nan_to_num(255 * np.log(np.clip(sphere.range_m, 0.5, 100) / 0.5) / np.log(200), nan=0.0).astype(np.uint8)
    colours = cv2.applyColorMap(shade, cv2.COLORMAP_JET) * sphere.measured[..., None]
    cv2.imwrite(str(options.stitch_pictures / f"{name}_range.png"), colours)
