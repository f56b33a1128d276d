"""Run times of mcl_depth in a town of 100 x 100 m: every step, the first global update, images after convergence."""

from __future__ import annotations

import argparse
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
from cycab_sim.worlds import build_world
from mcl_depth.belief.estimate import Estimate, Observation
from mcl_depth.filter import Filter
from mcl_depth.geometry.cloud import Cloud, cloud_from_points
from mcl_depth.geometry.mesh import TriangleMesh, mesh_from_faces
from mcl_depth.geometry.synthesis import DepthSynthesizer
from mcl_depth.likeness.comparison import depth_features_many, similarity_many, visual_features
from mcl_depth.params import FilterParams
from mcl_depth.site import Site
from mcl_depth.warm_up import warm_up
from sphere_geometry import SE3
from sphere_geometry.camera import pixel_grid
from typed_params import build

HELP = "synthesis, features, comparison, first global update, image after convergence, what each cache saves"
HEIGHT = 1.6  # m, of the camera
SIDE = 100.0  # m, of the town
MANY = 10  # runs of every step
SLOW = 8  # images of a drive without depth cache
STEP = 0.3  # m driven between two images
VARIANTS: dict[str, dict[str, Any]] = {
    "all caches": {},
    "no depth cache (as good as: 16 images)": {"cache.max_megabytes": 1},
}
Array = NDArray[np.float64]


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
    limits = {"area.limits": box}
    built_ms, site = milliseconds(lambda: Site(cloud, HEIGHT, build(FilterParams, limits)))
    count = 64 if options.quick else 256
    places = some_places(site, count)
    truth = inside(DepthSynthesizer(mesh, site.params.synthesis), places, box)
    report.notes.append(f"{len(cloud)} points, made ready in {built_ms / 1e3:.1f} s, {len(site.area.middles)} squares")
    report.tables.append(steps(site, cloud, places, truth, report, 3 if options.quick else MANY))
    report.tables.append(updates(site, mesh, limits, options, report))
    return report


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


def some_places(site: Site, count: int) -> Array:
    """Return positions (count, 3) of cameras all over the area."""
    middles = site.area.scattered(count)
    return np.column_stack([middles, site.depth_map.heights(middles)])


def inside(exact: DepthSynthesizer, places: Array, box: str) -> NDArray[np.float32]:
    """Return the ranges at places, NaN where a ray ends outside x0,y0,x1,y1, where the cloud has no points."""
    found = exact.synthesize_many(places)
    rays = exact.camera.unproject(pixel_grid(exact.camera)).astype(np.float32)
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


def updates(
    site: Site, mesh: TriangleMesh, limits: dict[str, Any], options: argparse.Namespace, report: Report
) -> Table:
    """Time whole updates of the filter on a drive, with everything and without one thing at a time."""
    exact = DepthSynthesizer(mesh, site.params.synthesis)
    observations = drive(site, exact, 20 if options.quick else options.images)
    rows: list[tuple[str, ...]] = []
    warm_up(site.params)
    chosen = dict(list(VARIANTS.items())[:1]) if options.quick else VARIANTS
    for name, changes in tqdm(chosen.items(), "drives", leave=False, disable=None):
        tried = site.under(build(FilterParams, limits | changes))
        cold, ms, last = timed(tried.filter(), observations if "no depth" not in name else observations[:SLOW])
        cache, belief = tried.depth_map.cache, last.belief
        assert belief is not None
        settled, used = np.median(ms[len(ms) // 2 :], axis=0)
        rates = f"{cache.hit_rate:.0%}", f"{belief.comparison.hit_rate:.0%}"
        times = f"{cold[0]:.0f}", f"{cold[1]:.0f}", f"{settled:.1f}", f"{used:.1f}"
        rows.append((name, *times, *rates, str(len(belief.particles))))
        if not changes:
            report.bounds.append(Bound("first global update, 1000 particles", 2000.0, float(cold[0]), "ms"))
            report.bounds.append(Bound("image after convergence, median", 100.0, float(settled), "ms"))
    head = (
        "variant",
        "first [ms]",
        "of processor [ms]",
        "later, median [ms]",
        "of processor [ms]",
        "depth hits",
        "similarity hits",
        "particles",
    )
    return Table(
        "Updates: the first anywhere, 1000 particles, 36 headings, nothing in the caches; later ones near the truth",
        head,
        rows,
    )


def drive(site: Site, exact: DepthSynthesizer, num_images: int) -> list[Observation]:
    """Return images along a straight way through the area, odometry exact."""
    middles = site.area.middles
    way = STEP * np.arange(num_images + 1)
    for start in site.area.scattered(200):
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
    image = np.roll(shaded(exact.synthesize([*place, height])), round(heading / (2 * np.pi) * exact.camera.width), 1)
    T_odom_level = SE3.from_planar(float(place[0]), float(place[1]), heading)
    return Observation(image, exact.camera, number * 10**9, np.eye(3), T_odom_level)


def timed(tracked: Filter, observations: list[Observation]) -> tuple[Array, Array, Estimate]:
    """Return times (2,) in ms, by clock and of the processor, of the first image, and (N, 2) of those near the truth.

    The last estimate comes with them.
    """
    T_map_level = observations[0].T_odom_level  # here odometry is the truth
    assert T_map_level is not None
    times = []
    for item in observations:
        used = time.process_time()
        ms, estimate = milliseconds(partial(tracked.update, item))
        times.append((ms, 1e3 * (time.process_time() - used)))
        if item is observations[0]:
            tracked.start(T_map_level, np.diag([0.3, 0.3, 0.1, 0.05, 0.05, 0.1]) ** 2)
    return np.array(times[0]), np.array(times[1:]), estimate
