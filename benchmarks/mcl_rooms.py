"""Single rooms of many seeds, searched from nowhere: drives in their own geometry, and in that of two other rooms."""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from benchmarks.machine import describe
from benchmarks.mcl_walks import NEAR
from benchmarks.report import Bound, Report, Table
from mcl_depth.belief.estimate import Observation
from mcl_depth.belief.motion_model import compose_planar, relative_motion
from mcl_depth.filter import Filter
from mcl_depth.geometry.mesh import TriangleMesh, mesh_from_faces
from mcl_depth.geometry.synthesis import DepthSynthesizer
from mcl_depth.params import FilterParams, SynthesisParams
from mcl_depth.site import Site
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.camera import pixel_grid
from sphere_nav.localization.status import State
from sphere_nav.params import build

HELP = "MCL from nowhere in single rooms: their own, and others, where nothing may be claimed"
HEIGHT, COLUMNS = 1.2, 180  # of the camera, m; width of its panorama, px
NUM_IMAGES, STEP = 14, 0.3  # of a drive; between them, m
ODOMETRY = np.array([0.05, 0.05, np.radians(1.0)])  # errors: shares of the way, rad an image
NOISE, LIGHT = 2.0, 0.3  # of the image, grey levels; 1/m, by which surfaces are darker the farther from the lamp
SETTINGS = {"camera_height": HEIGHT, "resampling.num_particles": 400, "synthesis.num_columns": COLUMNS}


@dataclass(frozen=True)
class Outcome:
    """Of one drive: images in TRACKING, poses that left, how many were wrong, and the smallest p_chance."""

    num_tracking: int
    num_poses: int
    num_wrong: int
    smallest_p: float


@dataclass(frozen=True)
class Drive:
    """Images (K, H, W) of a camera, their true poses (K, 3) and odometry (K, 3)."""

    camera: Spherical
    images: list[NDArray[np.uint8]]
    poses: Array
    odometry: Array


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--first-room", type=int, default=100, help="seed of the first room (100)")
    parser.add_argument("--rooms", type=int, default=20, help="rooms, each also with images of two others (20)")


def run(options: argparse.Namespace) -> Report:
    """Drive once in each room; locate the images in it, and in the next two."""
    count = 4 if options.quick else options.rooms
    seeds = range(options.first_room, options.first_room + count)
    meshes = [room(seed) for seed in seeds]
    sites = [Site(mesh, HEIGHT, build(FilterParams, SETTINGS)) for mesh in meshes]
    found: dict[bool, list[Outcome]] = {True: [], False: []}
    for number, seed in enumerate(tqdm(seeds, "rooms", leave=False, disable=None)):
        made = drive(meshes[number], sites[number], seed)
        for other in range(3):
            found[other == 0].append(_locate(sites[(number + other) % count], made, seed, is_right=other == 0))
    report = Report("mcl_rooms", notes=[describe(options.threads)])
    head = ("map", "drives", "ever TRACKING", "with a wrong pose", "smallest p_chance, median", "of all")
    rows = [(name, *_figures(found[is_right])) for name, is_right in (("its own room", True), ("another room", False))]
    report.tables.append(Table(f"{NUM_IMAGES} images, {STEP:g} m apart, from nowhere", head, rows))
    claims = {is_right: sum(item.num_poses > 0 for item in items) for is_right, items in found.items()}
    wrong = float(sum(item.num_wrong for item in found[True]))
    what = f"{count} rooms from seed {seeds[0]}"
    report.bounds += [
        Bound(f"{what}: a pose within {NUM_IMAGES} images", 50.0, 100.0 * claims[True] / count, "%", is_minimum=True),
        Bound(f"{what}: wrong poses", 0.0, wrong, ""),
        Bound(f"{2 * count} drives in another room: ever a pose", 0.0, float(claims[False]), ""),
    ]
    return report


def room(seed: int) -> TriangleMesh:
    """Return a room of 5 to 9 m by 4 to 7 m with two to four boxes along its walls."""
    rng = np.random.default_rng([seed, 5])
    half = 0.5 * np.array([rng.uniform(5.0, 9.0), rng.uniform(4.0, 7.0)])
    boxes = [(np.array([*-half, 0.0]), np.array([*half, rng.uniform(2.4, 2.8)]))]
    for _ in range(rng.integers(2, 5)):
        along, sign = int(rng.integers(2)), rng.choice([-1.0, 1.0])
        size = np.array([rng.uniform(0.6, 1.8), rng.uniform(0.3, 0.9)])[:: 1 - 2 * along]
        middle = rng.uniform(-1.0, 1.0, 2) * (half - 0.5 * size)
        middle[1 - along] = sign * (half - 0.5 * size)[1 - along]
        boxes.append((np.array([*middle - 0.5 * size, 0.0]), np.array([*middle + 0.5 * size, rng.uniform(0.8, 2.1)])))
    corners = [[box[i][0], box[j][1], box[k][2]] for box in boxes for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    quads = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))
    faces = [[8 * n + i for i in t] for n in range(len(boxes)) for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return mesh_from_faces(np.array(corners), np.array(faces), f"room {seed}")


def drive(mesh: TriangleMesh, site: Site, seed: int) -> Drive:
    """Return a bend through the free part of a room, lit by a lamp."""
    rng = np.random.default_rng([seed, 9])
    synthesizer = DepthSynthesizer(mesh, SynthesisParams(num_columns=COLUMNS))
    camera, middles = synthesizer.camera, site.area.middles
    poses = np.full((NUM_IMAGES, 3), 1e9)
    while not site.area.contains(poses[:, :2]).all():
        poses[0] = *middles[rng.integers(len(middles))], rng.uniform(-np.pi, np.pi)
        step = np.array([STEP, 0.0, rng.uniform(-0.15, 0.15)])
        for index in range(1, NUM_IMAGES):
            poses[index] = compose_planar(poses[index - 1][None], step)[0]
    lamp, images, odometry = np.array([*rng.uniform(-1.0, 1.0, 2), HEIGHT]), [], [np.array([1.0, 2.0, 0.5])]
    for index, pose in enumerate(poses):
        place = np.array([*pose[:2], HEIGHT])
        points = place + synthesizer.synthesize_many(place[None])[0][..., None] * camera.unproject(pixel_grid(camera))
        bright = np.nan_to_num(255.0 / (1.0 + LIGHT * np.linalg.norm(points - lamp, axis=-1)))
        bright = np.roll(bright, round(pose[2] / (2.0 * np.pi) * COLUMNS), axis=1)
        images.append(np.clip(bright + rng.normal(0.0, NOISE, bright.shape), 0, 255).astype(np.uint8))
        if index:
            motion = relative_motion(poses[index - 1], pose)
            motion += ODOMETRY * [STEP, STEP, 1.0] * rng.standard_normal(3)
            odometry.append(compose_planar(odometry[-1][None], motion)[0])
    return Drive(camera, images, poses, np.array(odometry))


def _locate(site: Site, made: Drive, seed: int, *, is_right: bool) -> Outcome:
    """Return what a filter says of a drive; in another room every pose is wrong."""
    filter_ = Filter(replace(site.params, seed=seed), site.depth_map, site.area)
    states, chances, errors = [], [], []
    for index, (image, odometry) in enumerate(zip(made.images, made.odometry, strict=True)):
        level = SE3.from_planar(*(float(value) for value in odometry))
        seen = Observation(image, made.camera, (index + 1) * 500_000_000, np.eye(3), level)
        estimate = filter_.update(seen)
        states.append(estimate.status.state)
        chances.append(estimate.status.p_chance)
        if estimate.T_map_level is not None:
            off = estimate.T_map_level.translation[:2] - made.poses[index, :2]
            errors.append(float(np.hypot(off[0], off[1])) if is_right else np.inf)
    return Outcome(states.count(State.TRACKING), len(errors), int(np.sum(np.array(errors) > NEAR)), min(chances))


def _figures(found: list[Outcome]) -> tuple[str, ...]:
    chances = [item.smallest_p for item in found]
    tracking, wrong = sum(item.num_tracking > 0 for item in found), sum(item.num_wrong > 0 for item in found)
    return str(len(found)), str(tracking), str(wrong), f"{np.median(chances):.1e}", f"{min(chances):.1e}"
