"""Run times of mcl_depth in a town of 100 x 100 m: every step, the map made ready, the first image, later ones."""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from benchmarks.machine import describe, milliseconds, repeat
from benchmarks.report import Bound, Report, Table
from cycab_sim import geometry_cloud
from cycab_sim.world.worlds import build_world
from mcl_depth.belief.estimate import Observation
from mcl_depth.geometry.cloud import Cloud, cloud_from_points
from mcl_depth.geometry.mesh import TriangleMesh, mesh_from_faces
from mcl_depth.geometry.synthesis import DepthSynthesizer
from mcl_depth.likeness.comparison import depth_features_many, similarity_many, visual_features
from mcl_depth.params import FilterParams
from mcl_depth.site import Site, apply_preset
from mcl_depth.warm_up import warm_up
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.localization.status import State
from sphere_nav.params import build

HELP = "synthesis, features, comparison, the map made ready, first image, image after convergence"
HEIGHT = 1.6  # m, of the camera
SIDE = 100.0  # m, of the town
MANY = 10  # runs of every step
STEP = 1.0  # m driven between two images
STARTED_S = 5.0  # until a map on disk is ready


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--town-seed", type=int, default=3, help="seed of the town (3)")
    parser.add_argument("--cloud-spacing", type=float, default=0.2, help="m between points (0.2)")
    parser.add_argument("--images", type=int, default=40, help="images of the drive after the first (40)")


def run(options: argparse.Namespace) -> Report:
    """Measure all of it."""
    report = Report("mcl_times", notes=[describe(options.threads)])
    mesh, box = town_mesh(options.town_seed)
    cloud = cloud_of(options, box)
    with tempfile.TemporaryDirectory() as folder:
        params = build(FilterParams, {"area.limits": box, "cache.folder": folder})
        warm_up(apply_preset(params, cloud.box))
        site, table = readiness(cloud, params, report)
    report.tables.append(table)
    places = some_places(site, 64 if options.quick else 256)
    exact = DepthSynthesizer(mesh, site.params.synthesis)
    truth = inside(exact, places, box)
    report.tables.append(steps(site, cloud, places, truth, report, 3 if options.quick else MANY))
    report.tables.append(updates(site, drive(site, exact, options.images), report))
    return report


def readiness(cloud: Cloud, params: FilterParams, report: Report) -> tuple[Site, Table]:
    """Make the map of a cloud ready, with nothing on disk and once more with all of it; return the second site."""
    rows: list[tuple[str, ...]] = []
    for name in ("nothing on disk", "started again"):
        opened, site = clocked(partial(Site, cloud, HEIGHT, params, is_ready=False))
        made, _ = clocked(site.prepare)
        each = opened + made
        rows.append((name, *(f"{value / 1e3:.1f}" for value in (*opened, *made, *each))))
    report.notes.append(f"{len(cloud)} points, {len(site.places)} places, {len(site.area.middles)} squares")
    report.bounds += [
        Bound("map on disk: ready after", STARTED_S, each[0] / 1e3, "s"),
        Bound("map on disk: ready after, of processor", STARTED_S, each[1] / 1e3, "s"),
    ]
    head = ("map", "cloud opened [s]", "of processor", "depth images [s]", "of processor", "both [s]", "of processor")
    return site, Table(f"The map made ready, {len(site.places)} places", head, rows)


def clocked(call: Callable[[], Any]) -> tuple[Array, Any]:
    """Return times (2,) in ms, by clock and of the processor, and the result."""
    used = time.process_time()
    ms, result = milliseconds(call)
    return np.array([ms, 1e3 * (time.process_time() - used)]), result


def town_mesh(seed: int) -> tuple[TriangleMesh, str]:
    """Return the surfaces that the cloud was taken of, and its middle 100 x 100 m as x0,y0,x1,y1."""
    world = build_world("town", seed)
    faces = world.mesh.triangles[~world.mesh.is_clutter[world.mesh.surface_of]].astype(np.float64)
    x0, y0, x1, y1 = world.bounds
    middle, half = np.array([x0 + x1, y0 + y1]) / 2, np.minimum([x1 - x0, y1 - y0], SIDE) / 2
    mesh = mesh_from_faces(faces.reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3), "town")
    return mesh, ",".join(f"{value:.2f}" for value in (*(middle - half), *(middle + half)))


def cloud_of(options: argparse.Namespace, box: str) -> Cloud:
    """Return the points of the town inside x0,y0,x1,y1."""
    points = geometry_cloud(options.town_seed, options.cloud_spacing)
    x0, y0, x1, y1 = (float(word) for word in box.split(","))
    inside = np.all((points[:, :2] > [x0, y0]) & (points[:, :2] < [x1, y1]), axis=1)
    return cloud_from_points(points[inside], "town")


def scattered(site: Site, count: int) -> Array:
    """Return at most `count` middles of the area's squares from all over, in an order that jumps about, (K, 2)."""
    middles = site.area.middles
    picks = np.linspace(0, len(middles) - 1, min(count, len(middles))).round().astype(np.int64)
    return middles[np.random.default_rng(0).permutation(picks)]


def some_places(site: Site, count: int) -> Array:
    """Return positions (count, 3) of cameras all over the area."""
    middles = scattered(site, count)
    return np.column_stack([middles, site.depth_map.heights(middles)])


def inside(exact: DepthSynthesizer, places: Array, box: str) -> NDArray[np.float32]:
    """Return the ranges at places, NaN where a ray ends outside x0,y0,x1,y1, where the cloud has no points."""
    found = exact.synthesize_many(places)
    rays = pixel_rays(exact.camera).astype(np.float32)
    ends = places[:, None, None, :2].astype(np.float32) + found[..., None] * rays[..., :2]
    x0, y0, x1, y1 = (float(word) for word in box.split(","))
    with np.errstate(invalid="ignore"):
        is_inside = np.all((ends > [x0, y0]) & (ends < [x1, y1]), axis=-1)
    return np.where(is_inside, found, np.float32(np.nan))


def steps(site: Site, cloud: Cloud, places: Array, truth: NDArray[np.float32], report: Report, num_runs: int) -> Table:
    """Time the steps for each panorama in a batch, and compare the ranges with those of the surfaces."""
    rows: list[tuple[str, ...]] = []
    for drawing in ("columns",) if num_runs < MANY else ("columns", "splats"):
        synthesizer = site.synthesizer
        if drawing == "splats":
            synthesizer = DepthSynthesizer(cloud, site.params.synthesis, drawing)
        found = synthesizer.synthesize_many(places)
        ms, cpu = timed_batch(partial(synthesizer.synthesize_many, places), num_runs, len(places))
        rows.append((f"synthesis, {drawing}", f"{np.median(ms):.2f}", f"{cpu:.2f}", *accuracy(found, truth)))
        if drawing == "columns":
            report.bounds.append(Bound("synthesis of a panorama", 4.0, float(np.median(ms)), "ms"))
    comparison = site.params.comparison
    stack = depth_features_many(truth, comparison)
    ms, cpu = timed_batch(partial(depth_features_many, truth, comparison), num_runs, len(places))
    rows.append(("features", f"{np.median(ms):.2f}", f"{cpu:.2f}", "", "", ""))
    visual = visual_features(shaded(truth[0]))
    for count in (36, truth.shape[2]):
        ms, cpu = timed_batch(partial(similarity_many, visual, stack, count), num_runs, len(places))
        rows.append((f"comparison, {count} headings", f"{np.median(ms):.2f}", f"{cpu:.2f}", "", "", ""))
    head = (
        "for each panorama of a batch",
        "ms",
        "ms of processor",
        "median range error",
        "wrong by > 10 %",
        "unknown, though there",
    )
    return Table(f"Steps, {truth.shape[2]} x {truth.shape[1]}, {len(places)} panoramas", head, rows)


def timed_batch(call: Callable[[], Any], num_runs: int, count: int) -> tuple[Array, float]:
    """Return the times (num_runs,) in ms for each of `count` items, and the processor's, of both threads together."""
    call()
    used = time.process_time()
    ms = repeat(call, num_runs, 0) / count
    return ms, 1e3 * (time.process_time() - used) / num_runs / count


def accuracy(found: NDArray[np.float32], truth: NDArray[np.float32]) -> tuple[str, str, str]:
    """Return median relative error of ranges, share of wrong ones, and share of rays that end nowhere."""
    both = np.isfinite(found) & np.isfinite(truth)
    error = np.abs(found[both] / truth[both] - 1.0)
    holes = np.mean(np.isnan(found[np.isfinite(truth)]))
    return f"{np.median(error):.2%}", f"{np.mean(error > 0.1):.2%}", f"{holes:.2%}"


def shaded(range_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return grey levels of a range panorama: near is bright, with a little noise."""
    noise = np.random.default_rng(1).normal(0.0, 1.0, range_m.shape)
    return (255.0 / (1.0 + 0.1 * np.nan_to_num(range_m, nan=200.0)) + noise).astype(np.float32)


def updates(site: Site, observations: list[Observation], report: Report) -> Table:
    """Time whole updates of the filter on a drive from nowhere: the first, those of the search, those in TRACKING."""
    tracked, times, states = site.filter(), [], []
    for item in tqdm(observations, "images", leave=False, disable=None):
        used, estimate = clocked(partial(tracked.update, item))
        times.append(used)
        states.append(estimate.status.state)
    is_tracking = np.array([state is State.TRACKING for state in states])
    ms = np.array(times)
    first, search, later = (_median(part) for part in (ms[:1], ms[1:][~is_tracking[1:]], ms[is_tracking]))
    report.bounds += [
        Bound("first image, anywhere in the map", 2000.0, first[0], "ms"),
        Bound("first image, anywhere in the map, of processor", 2000.0, first[1], "ms"),
        Bound("image after convergence, median", 100.0, later[0], "ms"),
        Bound("image after convergence, median, of processor", 100.0, later[1], "ms"),
    ]
    rows: list[tuple[str, ...]] = [
        (name, str(count), f"{times[0]:.0f}", f"{times[1]:.0f}")
        for name, count, times in (
            ("the first", 1, first),
            ("later, SEARCHING or PROBATION", int(np.sum(~is_tracking[1:])), search),
            ("TRACKING", int(np.sum(is_tracking)), later),
        )
    ]
    title = f"An image, from nowhere in the map, {site.params.resampling.num_particles} particles, median"
    return Table(title, ("image", "images", "ms", "of processor [ms]"), rows)


def _median(times: Array) -> Array:
    """Return the medians (2,) of times (N, 2); NaN of none."""
    return np.median(times, axis=0) if len(times) else np.full(2, np.nan)


def drive(site: Site, exact: DepthSynthesizer, num_images: int) -> list[Observation]:
    """Return images along a straight way through the area, odometry exact."""
    middles = site.area.middles
    way = STEP * np.arange(num_images + 1)
    for start in scattered(site, 200):
        for heading in np.arange(0.0, 2 * np.pi, np.pi / 4):
            xy = start + way[:, None] * [np.cos(heading), np.sin(heading)]
            if np.all(np.min(np.linalg.norm(middles[:, None] - xy[:: len(xy) - 1], axis=2), axis=0) < 0.5) and np.all(
                site.area.contains(xy)
            ):
                return [observe(site, exact, place, heading, number) for number, place in enumerate(xy, 1)]
    raise ValueError(f"area: expected a straight way of {way[-1]:.1f} m, found none")


def observe(site: Site, exact: DepthSynthesizer, place: Array, heading: float, number: int) -> Observation:
    """Return what a camera sees at a place (2,)."""
    height = float(site.depth_map.heights(place[None])[0])
    image = np.roll(
        shaded(exact.synthesize_many([[*place, height]])[0]), round(heading / (2 * np.pi) * exact.camera.width), 1
    )
    T_odom_level = SE3.from_planar(float(place[0]), float(place[1]), heading)
    return Observation(image, exact.camera, number * 10**9, np.eye(3), T_odom_level)
