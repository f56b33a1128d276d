"""Places in different light that are not one: none may be joined; and how many that are one are joined.

A map of a few key spheres in a street of the simulator, and a drive of a few spheres in another light, somewhere else
or along the same street. Both go through what `sphere_nav map --extend` does where the localiser knows nothing:
features, then parts of the images. A second time as with its `--start` instead: what is somewhere else is said to begin
in the map, and of the drives along the same street every other one is said to begin 1 to 5 m from where it does. Ranges
are rough by a percent and end as those of a stereo rig do.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from benchmarks.bare.drives import LIGHTS, READ_NOISE, SHOT_NOISE, kidnapped_line, on_ground, shadows_in
from benchmarks.report import Bound, Headline, Report, Table
from benchmarks.room import motions
from cycab_sim.rendering.renderer import Renderer
from cycab_sim.sensors.imaging import expose
from cycab_sim.world.town import draw_plan
from cycab_sim.world.worlds import World, build_world
from sphere_mapping.experiences.joining import join_drive
from sphere_mapping.graph.extension import Submap
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.geometry.arrays import Array
from sphere_nav.spheres.appearance.features import features_of_sphere
from sphere_nav.spheres.appearance.index import AppearanceIndex
from sphere_nav.spheres.graph import KeySphere, SphereGraph
from sphere_nav.spheres.sphere import Sphere
from worlds.submaps import images_of

CAMERAS = {"whole": Spherical(256, 128), "window": Spherical(160, 110, 512.0, 176.0, 60.0)}
NUM_PAIRS = {"quick": 14, "full": 1000}  # half of them in the next town
SAME_EVERY = 10  # one of so many pairs is of one place
NUM_SPHERES, STEP_M = 4, 1.0  # of a map and of a drive
ASIDE_M, TURNED_RAD = 0.4, 0.15  # of a drive beside a map: standard deviations
NOISE, REACH_M = 0.01, 30.0  # of ranges: share; farthest
HEIGHT_M = 1.6  # of the sphere above the ground
APART_M = 12.0  # between places that are not one, at least
WRONG_M = 0.3  # of a true pair, joined there
GIVEN_M, GIVEN_RAD = 0.35, 0.3  # off the truth along each axis, at most, where a start is given rightly
GIVEN_WRONG_M = (1.0, 5.0)  # where it is given wrongly


def run(options: argparse.Namespace) -> Report:
    """Join pair after pair, with a start that is given and without."""
    report, rows = Report("false_joins", notes=[__doc__ or ""]), list[tuple[str, ...]]()
    count = NUM_PAIRS[options.size]
    for is_given in (False, True):
        before, num_true, num_same = len(rows), 0, 0
        for number in range(count):
            is_same = number % SAME_EVERY == 0
            is_right = is_same and (not is_given or number % (2 * SAME_EVERY) == 0)
            given = (_off_a_little if is_right else _off_far) if is_given else None
            town, camera = options.seed + number * 2 // count, list(CAMERAS)[number % len(CAMERAS)]
            error_m, told = _try(town, number, camera, is_same=is_same, given=given)
            num_same += is_right
            num_true += is_right and error_m <= WRONG_M
            if error_m < np.inf and (not is_same or error_m > WRONG_M):
                rows.append((str(town), str(number), camera, "one place" if is_same else "two", f"{error_m:.2f}", told))
        what = f"{count} pairs{', a start given,' if is_given else ''}"
        report.bounds.append(Bound(f"false joins of {what}", 0, len(rows) - before, ""))
        report.notes.append(f"{what}: of {num_same} that were of one place {num_true} were joined")
    headline = Headline("robustness", "towns, four lights")
    report.bounds.append(Bound(f"false joins of {2 * count} pairs, both ways", 0, len(rows), "", headline=headline))
    report.tables.append(Table("False joins", ("town", "pair", "camera", "of", "off by m", "how"), rows))
    return report


def _off_a_little(rng: np.random.Generator) -> SE3:
    return SE3.from_planar(*rng.uniform(-1.0, 1.0, 3) * [GIVEN_M, GIVEN_M, GIVEN_RAD])


def _off_far(rng: np.random.Generator) -> SE3:
    ahead = rng.uniform(*GIVEN_WRONG_M) * rng.choice([-1.0, 1.0])
    return SE3.from_planar(ahead, *rng.uniform(-1.0, 1.0, 2) * [GIVEN_M, GIVEN_RAD])


def _try(
    town: int, number: int, camera: str, *, is_same: bool, given: Callable[[np.random.Generator], SE3] | None = None
) -> tuple[float, str]:
    """Join a pair; return how far off in m the drive is placed, infinite where it is not, and how it was placed.

    `given`: draws how far off the start is, from where the drive begins, or from the map's first key sphere.
    """
    rng = np.random.default_rng([town, number, 5])
    plan = draw_plan(town)
    line = kidnapped_line(plan, NUM_SPHERES, STEP_M, rng)
    other = line
    while not is_same and np.linalg.norm(other[:, None, :2] - line[None, :, :2], axis=-1).min() < APART_M:
        other = kidnapped_line(plan, NUM_SPHERES, STEP_M, rng)
    moved = rng.normal(0.0, [ASIDE_M, ASIDE_M, TURNED_RAD])
    drive_line = other + moved if is_same else other
    first, second = rng.choice(len(LIGHTS), 2, replace=False)
    lens = CAMERAS[camera]
    base = _submap(town, line, int(first), lens, rng, 0, SE3.identity())
    T = SE3.from_planar(*rng.uniform(-5.0, 5.0, 3))
    drive = _submap(town, drive_line, int(second), lens, rng, 100, T)
    start = None
    if given is not None:
        begin = T.inverse() @ drive.graph[100].T_map_sphere if is_same else base.graph[0].T_map_sphere
        start = begin @ given(rng)
    joined = join_drive(base, drive, images_of(drive), start)
    if joined.graph is None:
        return np.inf, joined.told
    truth = [T.inverse() @ node.T_map_sphere for node in drive.graph]
    placed = [joined.graph[node.id].T_map_sphere for node in drive.graph]
    return max(float(a.distance(b)[0]) for a, b in zip(truth, placed, strict=True)), joined.told


def _submap(
    town: int, line: Array, light: int, lens: Spherical, rng: np.random.Generator, first: int, T: SE3
) -> Submap:
    """Return what a drive along planar poses (K, 3) sees, in a frame moved by `T`."""
    world, renderer = _town(town, light)
    up = SE3.from_parts(np.eye(3), [0.0, 0.0, HEIGHT_M])
    index, nodes, spheres = AppearanceIndex(), [], {}
    for number in range(len(line)):
        pose = on_ground(world.ground, line[number]) @ up
        levels, range_m = renderer.render(lens, pose, is_gray=True)
        image: NDArray[np.uint8] = expose(levels, READ_NOISE, SHOT_NOISE, (town, light, number))
        rough = range_m * (1.0 + NOISE * rng.normal(size=range_m.shape))
        rough = np.where(rough < REACH_M, rough, np.nan)
        sphere = Sphere(np.maximum(image, 1), rough.astype(np.float32), lens, number)
        node = KeySphere(first + number, number, T @ pose, region_radius_m=3.0)
        spheres[node.id] = sphere
        index.add(node.id, features_of_sphere(sphere))
        nodes.append(node)
    return Submap(SphereGraph(nodes, motions(nodes)), index, spheres.__getitem__)


@lru_cache(maxsize=len(LIGHTS))
def _town(seed: int, light: int) -> tuple[World, Renderer]:
    """Return a town without traffic, and what draws it in a light."""
    world = build_world("town", seed, "block")
    return world, Renderer(world.mesh, shadows_in(LIGHTS[light]), LIGHTS[light])
