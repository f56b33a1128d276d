"""How fast the simulator draws: pixels per second and core, for each kind of camera; and what traffic costs."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np

from benchmarks.machine import describe
from benchmarks.report import Report, Table
from cycab_sim.params import CONDITIONS, LightParams, RenderParams, SimParams, TrafficParams, in_condition
from cycab_sim.rendering.renderer import Renderer
from cycab_sim.sensors.cameras import OPTICAL
from cycab_sim.simulator import T_BASE_TORCH
from cycab_sim.world.season import change_season
from cycab_sim.world.traffic.traffic import Traffic
from cycab_sim.world.worlds import World, build_world
from sphere_nav.geometry import SE3, Camera, Fisheye, Pinhole, Spherical

HELP = "the simulator's images: pixels per second and core for each kind of camera, with traffic, in each condition"
PLACES = (0.1, 0.3, 0.5, 0.7, 0.9)  # of the taught path
CAMERAS: dict[str, Camera] = {
    "pinhole 512 x 384": Pinhole(512, 384, 305.0, 305.0, 255.5, 191.5),
    "fisheye 544 x 544 (rig)": Fisheye(544, 544, 164.0, 164.0, 271.5, 271.5),
    "sphere 1024 x 512": Spherical(1024, 512),
}
WORLDS: dict[str, tuple[str, TrafficParams | None]] = {
    "town": ("town", None),
    "town, traffic": ("town", TrafficParams(density="usual")),
    "city, traffic": ("city", TrafficParams(density="busy")),
}
INSTANTS = 10  # at which traffic is moved


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Nothing but the common ones."""


def run(options: argparse.Namespace) -> Report:
    """Draw on one core at several places of a town and a city."""
    rows: list[tuple[str, ...]] = []
    moves: list[tuple[str, ...]] = []
    for name, (kind, params) in WORLDS.items():
        world = build_world(kind, 1)
        traffic = Traffic(world, params, 1) if params else None
        bounds = world.bounds if world.is_wide else None
        renderer = Renderer(world.mesh, RenderParams(), LightParams(), traffic, bounds, num_threads=1)
        if traffic is not None:
            moves.append(
                (name, f"{len(traffic.actors)}", f"{len(traffic.mesh.triangles)}", _move_time(renderer, traffic))
            )
        rows += [(name, what, *_measure(renderer, world, c, options.quick)) for what, c in CAMERAS.items()]
    lights = [(name or "default", *_measure_condition(name, options.quick)) for name in ("", *CONDITIONS)]
    columns = ("world", "camera", "pixels per second and core", "microseconds per pixel", "ms per image")
    tables = [
        Table("One thread, RGB", columns, rows),
        Table("Conditions: one thread, town, pinhole 512 x 384, RGB", ("condition", *columns[2:]), lights),
        Table("Moving the traffic to another instant", ("world", "actors", "triangles", "ms"), moves),
    ]
    return Report("rendering", tables, notes=[describe(options.threads)])


def _measure(renderer: Renderer, world: World, camera: Camera, is_quick: bool) -> tuple[str, str, str]:
    rotation = np.eye(3) if isinstance(camera, Spherical) else OPTICAL
    num, places = camera.width * camera.height, iter((PLACES[:1] + PLACES) if not is_quick else PLACES[:3])

    def draw() -> None:
        x, y, yaw, _ = world.path.at(np.array(next(places) * world.path.length))
        T_world_camera = SE3.from_planar(float(x), float(y), float(yaw)) @ SE3.from_parts(rotation, [0.0, 0.0, 1.6])
        renderer.render(camera, T_world_camera)

    each = _median_time(draw, 2 if is_quick else len(PLACES))  # the first time, the rays of the lens are made
    return f"{num / each:.3g}", f"{1e6 * each / num:.2f}", f"{1e3 * each:.0f}"


def _measure_condition(name: str, is_quick: bool) -> tuple[str, str, str]:
    params, world = in_condition(SimParams(condition=name)), build_world("town", 1)
    mesh = change_season(world.mesh, params.season, 1)
    renderer = Renderer(mesh, RenderParams(), params.light, num_threads=1, season=params.season)
    x, y, yaw, _ = world.path.at(np.array(0.5 * world.path.length))
    renderer.torch = SE3.from_planar(float(x), float(y), float(yaw)) @ T_BASE_TORCH
    return _measure(renderer, world, CAMERAS["pinhole 512 x 384"], is_quick)


def _move_time(renderer: Renderer, traffic: Traffic) -> str:
    stamps = iter(range(10**9, (INSTANTS + 2) * 10**9, 10**9))
    return f"{1e3 * _median_time(lambda: renderer.move(traffic.poses(next(stamps))), INSTANTS):.1f}"


def _median_time(action: Callable[[], None], count: int) -> float:
    """Return the median CPU time of an action in s, after a first one that does not count."""
    seconds = []
    for _ in range(count + 1):
        begun = time.process_time()
        action()
        seconds.append(time.process_time() - begun)
    return float(np.median(seconds[1:]))
