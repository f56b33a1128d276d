"""A drive of 1.5 km through a town, loops in both directions and a crossing, mapped from a sphere a metre apart.

The spheres are drawn as a vertical rig of 0.4 m would give them at their width: noise of the image, ranges whose noise
grows with their square and end at 60 m. The stitcher is left out, so that a drive takes minutes instead of an hour.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import reduce

import numpy as np
from tqdm import tqdm

from benchmarks.commands import num_false
from benchmarks.drive.street import rounded_way
from benchmarks.report import Bound, Headline, Report, Table
from cycab_sim.params import LightParams, RenderParams
from cycab_sim.rendering.renderer import Renderer
from cycab_sim.world.town import draw_plan
from cycab_sim.world.worlds import build_world
from sphere_mapping.graph.merging import merge
from sphere_mapping.mapper import Mapper
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.spheres.graph import SphereGraph
from sphere_nav.spheres.sphere import Sphere
from sphere_nav_tools.offline.evaluation import evaluate_poses

SIZES = {"quick": (120.0, 256, 1), "full": (1500.0, 512, 2)}  # m, px of the spheres, towns
SPACING_M, STEP_NS = 1.0, 250_000_000
TOWN_LAP_M = 380.0  # of the drive, on which there is one lap to the left
LANE_M, RADIUS_M = 1.75, 5.0  # to the right of the middle of the street; of turns, where there is room
HEIGHT_M, NOISE = 1.6, 2.0  # above the ground; grey levels
RANGE_NOISE, FARTHEST_M = 1.5e-3, 60.0  # m/m^2: 0.2 px of a baseline of 0.4 m at 2048 px
FALSE_LOOP = 0.3, 2.0  # m, deg: error above which a loop joins what does not belong together


@dataclass
class Drive:
    """What was mapped, the true poses by stamp, and what it cost."""

    mapper: Mapper
    truth: dict[int, SE3] = field(default_factory=dict)
    num_lost: int = 0
    seconds: list[float] = field(default_factory=list)


def run(options: argparse.Namespace) -> Report:
    """Drive and map in a town, or two."""
    report, rows = Report("long_map", notes=[__doc__ or ""]), list[tuple[str, ...]]()
    length, width, num_towns = SIZES[options.size]
    for seed in range(options.seed, options.seed + num_towns):
        drive = map_drive(seed, length, width)
        _judge(f"town {seed}, {length:.0f} m", drive, report, rows)
    columns = ("drive", "placed", "lost", "kept", "after merging", "loops", "CPU s a sphere")
    worst = max(bound.measured for bound in report.bounds if "RMSE" in bound.what)
    false = sum(bound.measured for bound in report.bounds if "false loops" in bound.what)
    told = Headline("map", f"{len(rows)} drives of {length:.0f} m", "M15 shows a drawing")
    report.bounds.append(Bound("RMSE of positions after closure, worst drive", 0.25, worst, "m", headline=told))
    report.bounds.append(Bound("false loops of all drives", 0, false, "", headline=told))
    report.tables.append(Table("Drives", columns, rows))
    return report


def map_drive(seed: int, length: float, width: int) -> Drive:
    """Map a drive through a town."""
    renderer = Renderer(build_world("town", seed).mesh, RenderParams(), LightParams())
    rng = np.random.default_rng([seed, 8])
    drive = Drive(Mapper())
    number = int(length / SPACING_M)
    for index, pose in enumerate(tqdm(_poses(seed, number), total=number, disable=None)):
        sphere = draw(renderer, pose, width, STEP_NS * index, rng)
        begun = time.process_time()
        drive.truth[sphere.stamp_ns] = pose
        drive.num_lost += drive.mapper.add(sphere).T_map_sphere is None
        drive.seconds.append(time.process_time() - begun)
    drive.mapper.keep_end()
    drive.mapper.close_loops()
    return drive


def draw(renderer: Renderer, pose: SE3, width: int, stamp_ns: int, rng: np.random.Generator) -> Sphere:
    """Return what a vertical rig sees and measures: noise of ranges grows with their square, and they end."""
    camera = Spherical(width, width // 2)
    levels, range_m = renderer.render(camera, pose, is_gray=True)
    image = np.clip(np.rint(levels + rng.normal(0.0, NOISE, levels.shape)), 1, 255).astype(np.uint8)
    noise = RANGE_NOISE * np.square(np.minimum(range_m, FARTHEST_M)) * rng.normal(size=range_m.shape)
    found = np.where(range_m < FARTHEST_M, np.maximum(range_m + noise, 0.1), np.nan)
    return Sphere(image, found.astype(np.float32), camera, stamp_ns)


def route(seed: int, length: float) -> Array:
    """Return corners (K, 2) m of the drive: blocks to the left, over a crossing, blocks to the right."""
    lane, plan = LANE_M, draw_plan(seed)
    e, n = plan.east, plan.north
    left = [(e + lane, -lane), (e + lane, n + lane), (-lane, n + lane), (-lane, -lane)]
    right = [(lane, n - lane), (e - lane, n - lane), (e - lane, lane), (lane, lane)]
    over = [(-lane, -25.0), (lane, -25.0)]  # past the crossing, round, and back over it
    laps = max(round(length / TOWN_LAP_M), 1)
    return np.array([(-25.0, -lane), *(left * laps)[:-1], *over, *right * 20])


def _poses(seed: int, number: int) -> Iterator[SE3]:
    path = rounded_way(route(seed, number * SPACING_M), RADIUS_M)
    above = SE3.from_parts(np.eye(3), [0.0, 0.0, HEIGHT_M])
    for x, y, yaw, _ in path.at(SPACING_M * np.arange(number)):
        yield SE3.from_planar(float(x), float(y), float(yaw)) @ above


def _judge(what: str, drive: Drive, report: Report, rows: list[tuple[str, ...]]) -> None:
    """Add what a drive's map is worth."""
    graph = drive.mapper.graph
    stamps, poses = zip(*drive.mapper.trajectory(), strict=True)
    found, true = (
        Trajectory(np.array(stamps), SE3(np.stack([pose.matrix for pose in these])))
        for these in (poses, [drive.truth[stamp] for stamp in stamps])
    )
    merged, length = merge(graph, found.positions), float(true.distances[-1])
    ate = evaluate_poses(found, true, alignment="se3").report["translation_m"]["rmse"]
    loops = [edge for edge in graph.edges if edge.is_loop]
    false = num_false(loops, {node.id: drive.truth[node.stamp_ns] for node in graph}, FALSE_LOOP)
    counts = (len(stamps), drive.num_lost, len(graph), len(merged), len(loops))
    rows.append((what, *map(str, counts), f"{np.mean(drive.seconds):.2f}"))
    report.bounds += [
        Bound(f"{what}: drift of the chain at its end over its length", 0.5, 100 * _drift(graph, drive) / length, "%"),
        Bound(f"{what}: RMSE of all positions after closure", 0.25, ate, "m"),
        Bound(f"{what}: false loops", 0.0, false, f"of {len(loops)}"),
        Bound(f"{what}: frames dropped", 75.0, 100 * (1 - len(merged) / len(stamps)), "%", is_minimum=True),
    ]


def _drift(graph: SphereGraph, drive: Drive) -> float:
    """Return how far in m the last key sphere is off by the motions from one to the next alone, no loop heard."""
    chain = {edge.b: edge for edge in graph.edges if not edge.is_loop}
    nodes = sorted(graph.nodes)
    T_first_last = reduce(SE3.__matmul__, (chain[node_id].T_a_b for node_id in nodes[1:]), SE3.identity())
    first, last = (drive.truth[graph[node_id].stamp_ns] for node_id in (nodes[0], nodes[-1]))
    return float((first.inverse() @ last).distance(T_first_last)[0])
