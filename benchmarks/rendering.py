"""How fast the simulator draws: pixels per second and core, for each kind of camera."""

from __future__ import annotations

import argparse
import time

import numpy as np

from benchmarks.machine import describe
from benchmarks.report import Report, Table
from cycab_sim.cameras import OPTICAL
from cycab_sim.params import LightParams, RenderParams
from cycab_sim.renderer import Renderer
from cycab_sim.worlds import build_world
from sphere_geometry import SE3, Camera, Fisheye, Pinhole, Spherical

HELP = "the simulator's images: pixels per second and core for each kind of camera"
PLACES = (10.0, 30.0, 50.0, 70.0, 90.0)  # m along the taught path
CAMERAS: dict[str, Camera] = {
    "pinhole 512 x 384": Pinhole(512, 384, 305.0, 305.0, 255.5, 191.5),
    "fisheye 544 x 544 (rig)": Fisheye(544, 544, 164.0, 164.0, 271.5, 271.5),
    "sphere 1024 x 512": Spherical(1024, 512),
}


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Nothing but the common ones."""


def run(options: argparse.Namespace) -> Report:
    """Draw on one core at several places of the town."""
    world = build_world("town", 1)
    renderer = Renderer(world.mesh, RenderParams(num_threads=1), LightParams())
    rows = [(name, *_measure(renderer, world.path.at, camera, options.quick)) for name, camera in CAMERAS.items()]
    columns = ("camera", "pixels per second and core", "microseconds per pixel", "ms per image")
    return Report("rendering", [Table("One thread, RGB", columns, rows)], notes=[describe(options.threads)])


def _measure(renderer: Renderer, at, camera: Camera, is_quick: bool) -> tuple[str, str, str]:  # type: ignore[no-untyped-def]
    rotation = np.eye(3) if isinstance(camera, Spherical) else OPTICAL
    num, seconds = camera.width * camera.height, []
    for s in (PLACES[:1] + PLACES) if not is_quick else PLACES[:3]:  # the first time, the rays of the lens are made
        x, y, yaw, _ = at(np.array(s))
        T_world_camera = SE3.from_planar(float(x), float(y), float(yaw)) @ SE3.from_parts(rotation, [0.0, 0.0, 1.6])
        begun = time.process_time()
        renderer.render(camera, T_world_camera)
        seconds.append(time.process_time() - begun)
    each = float(np.median(seconds[1:]))
    return f"{num / each:.3g}", f"{1e6 * each / num:.2f}", f"{1e3 * each:.0f}"
