"""A recorded room by night: a torch alone, and a light that goes out; images placed by colour, and with depth.

The next but one of each third image by day is a drive, seen by a torch beside the lens, by the same while part of the
texture is inverted, or not at all from the 13th image on. The start is given, 0.1 m and 5 deg off.
"""

from __future__ import annotations

import argparse
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.commands import TRUTH
from benchmarks.light.relight import TITLE, Light, Room, in_kitchen, torch_light
from benchmarks.report import Bound, Headline, Report, Table
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav_tools.offline.evaluation import read_poses

OFF = np.array([0.1, 0.0, 0.0, 0.0, 0.0, np.radians(5.0)])  # of the start, from the truth
LIT = 12  # images until the light goes out


class Torch(Light):
    """Night but for a lamp beside the lens."""

    def _light(self, world: Array, facing: Array, points: Array, normals: Array) -> Array:
        return 0.02 + 1.6 * torch_light(points, normals)


def run(options: argparse.Namespace) -> Report:
    """Measure every darkness."""
    report, rows = Report("dark", notes=[__doc__ or ""]), list[tuple[str, ...]]()

    def measure(room: Room) -> None:
        day = room.base()
        numbers = count(1)
        out = SimpleNamespace(shine=lambda gray, *_: gray if next(numbers) <= LIT else np.zeros_like(gray))
        nights: dict[str, Any] = {"torch": room.light("lamp", 1.0, options.seed, Torch), "out": out}
        if options.size == "full":
            nights["patches"] = room.light("season", 1.0, options.seed, Torch)
        for name, light in nights.items():
            start = start_near(room.folder / room.drive(name, light, 2))
            colour = room.localize("map_day", f"{name}_2", start)
            depth = room.localize("map_day", f"{name}_2", start, "--set", "use_depth=true")
            rows.append((name, str(colour), str(depth)))
            of = Headline("other light", "redkitchen by night, the camera's depth", f"by day {day.placed}")
            told = of if name == "torch" else None
            report.bounds += [
                Bound(f"{name}: images placed with depth", day.placed, depth.placed, "", True, told),
                Bound(f"{name}: wrong, both ways", 0, colour.num_wrong + depth.num_wrong, ""),
            ]
        report.tables.append(Table(TITLE, ("night", "colour", "with depth"), rows))

    return in_kitchen(options, report, measure)


def start_near(bag: Path) -> str:
    """Return the option that gives the start of a drive, a little off."""
    truth = read_poses(bag, TRUTH).T_map_body[0] @ SE3.exp(OFF)
    numbers = *truth.translation, *Rotation.from_matrix(truth.rotation).as_quat()
    return f"--initial-pose={','.join(f'{number:.6f}' for number in numbers)}"
