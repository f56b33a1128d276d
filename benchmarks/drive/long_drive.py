"""`sphere_nav demo`: taught, mapped, and driven again on another day by one camera, all nodes over DDS in lock-step.

The tour of 490 m through the simulator's city with traffic, or a street of 30 m.
"""

from __future__ import annotations

import argparse
import json

from benchmarks.commands import run as run_command
from benchmarks.report import Bound, Headline, Report

PATHS = {"quick": ("--path", "straight"), "full": ("--path", "tour", "--traffic")}


def run(options: argparse.Namespace) -> Report:
    """Teach, drive, compare."""
    folder = options.folder / "demo"
    said = run_command("demo", "-o", folder, "--seed", options.seed, *PATHS[options.size])
    if not (folder / "result.json").is_file():
        raise ValueError(f"demo: expected result.json, found {said.out.strip().splitlines()[-1]}")
    found = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    of = Headline("drives and missions", f"{found['length_m']:.0f} m of a town on another day, by one camera")
    bounds = [
        Bound("drive by one camera, lateral RMSE", 3.0, 100 * found["lateral_rmse_m"], "cm", headline=of),
        Bound("the same, largest", 15.0, 100 * found["lateral_max_m"], "cm"),
        Bound("the same, share driven", 0.98, found["share_driven"], "", is_minimum=True),
        Bound("the same, driven to its end", 1, int(found["has_finished"]), "", is_minimum=True),
    ]
    return Report(
        "long_drive", bounds=bounds, notes=[__doc__ or "", f"{found['num_key_spheres']} key spheres; {found['end']}"]
    )
