"""A county's survey: fifty million points of a town in UTM, as tiles of .laz; is the first pose in the right place?

The map is read by a process of its own, so that its memory is that of a node that loads it: all tiles, and those that
an area with its origin needs. Drives begin anywhere on the area.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np

from benchmarks import mcl_sites
from benchmarks.machine import describe
from benchmarks.mcl_drives import HEIGHT
from benchmarks.mcl_routes import limits
from benchmarks.mcl_town import kidnapped
from benchmarks.mcl_trials import NEAR_M, run_filter
from benchmarks.report import Bound, Report, Table
from cycab_sim.world.town import draw_plan
from cycab_sim.world.worlds import geometry_cloud
from mcl_depth.params import MclDepthParams
from mcl_depth.ros.clouds import read_map
from mcl_depth.site import Site
from sphere_nav.params import build

HELP = "a survey of fifty million points in UTM: memory, time, first pose"
NUM_POINTS = 50_000_000
SPACING = 0.1  # m, of the points that are drawn; the rest are these with the noise of a scanner
NOISE = 0.02  # m
ORIGIN = np.array([500_200.0, 5_412_300.0, 212.0])  # E, N, H of the town's own origin
TILE = 100.0  # m, side of a tile
NUM_DRIVES = 10


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--points", type=int, default=NUM_POINTS, help="of the survey (%(default)s)")


def run(options: argparse.Namespace) -> Report:
    """Write a survey, read it in two ways, start everywhere."""
    count = 2_000_000 if options.quick else options.points
    folder = mcl_sites.folder_of(options) / f"survey_{options.world_seed}_{count}"
    if not folder.is_dir():  # in a process of its own: the memory of this one is judged
        code = "import sys; from pathlib import Path; from benchmarks.survey_tiles import write_survey; "
        code += f"write_survey(Path({str(folder)!r}), {options.world_seed}, {count})"
        subprocess.run([sys.executable, "-c", code], check=True)
    plan = draw_plan(options.world_seed)
    box = ",".join(f"{value:.2f}" for value in limits(plan))
    origin = ",".join(f"{value:g}" for value in ORIGIN)
    settings = {"preset": "outdoor", "area.limits": box, "survey.origin": origin}
    report = Report("survey_tiles", notes=[describe(options.threads)])
    rows = []
    for name, changes in (("all tiles", {"area.limits": ""}), ("those of the area", {})):
        seconds, megabytes, num_kept = cost(folder, settings | changes)
        rows.append((name, str(count), str(num_kept), f"{seconds:.0f}", f"{megabytes:.0f}"))
        report.bounds.append(Bound(f"memory to read {name}", 2000.0, megabytes, "MB"))
    report.tables.append(Table("Reading", ("what", "points", "kept", "s", "MB"), rows))
    params = build(MclDepthParams, settings)
    site = Site(read_map(str(folder), params), HEIGHT, params)
    studio = mcl_sites.studio("town", options)
    drives = kidnapped(studio, plan, 3 if options.quick else options.starts or NUM_DRIVES)
    trials = [run_filter(site, drive, replace(site.params), seed) for seed, drive in enumerate(drives)]
    right = 100.0 * sum(trial.has_converged for trial in trials) / len(trials)
    false = float(sum(trial.num_false > 0 for trial in trials))
    report.bounds += [
        Bound(f"drives of {len(trials)} in TRACKING at the right place at their end", 95.0, right, "%", True),
        Bound(f"drives with TRACKING beyond {NEAR_M:g} m", 0.0, false, ""),
        Bound("memory with depth images, filter and images", 2000.0, peak_mb(), "MB"),
    ]
    return report


def write_survey(folder: Path, seed: int, count: int) -> None:
    """Write the points of a town, repeated with noise until there are so many, as tiles in UTM."""
    town = geometry_cloud(seed, SPACING, "town")
    tiles = np.floor(town[:, :2] / TILE).astype(np.int64)
    kinds, owner = np.unique(tiles, axis=0, return_inverse=True)
    repeats = -(-count // len(town))
    partial = folder.with_name(folder.name + ".partial")
    partial.mkdir(parents=True, exist_ok=True)
    for number, kind in enumerate(kinds):
        own = town[owner.ravel() == number]
        rng = np.random.default_rng([seed, number, 29])
        header = laspy.LasHeader(point_format=6, version="1.4")
        header.scales, header.offsets = np.full(3, 0.001), ORIGIN
        keys = np.array([[1, 1, 0, 1], [3076, 0, 1, 9001]], "<u2")
        header.vlrs.append(laspy.VLR("LASF_Projection", 34735, "", keys.tobytes()))
        with laspy.open(partial / f"{kind[0]}_{kind[1]}.laz", "w", header=header) as file:
            for _ in range(repeats):
                points = laspy.ScaleAwarePointRecord.zeros(len(own), header=header)
                points.x, points.y, points.z = (own + ORIGIN + rng.normal(0.0, NOISE, own.shape)).T
                file.write_points(points)
    partial.rename(folder)


def cost(folder: Path, settings: dict[str, str]) -> tuple[float, float, int]:
    """Return seconds, peak of memory in MB, and points of a process that reads a survey."""
    code = (
        "import resource\n"
        "from benchmarks.survey_tiles import peak_mb\n"
        "from mcl_depth.params import MclDepthParams\n"
        "from mcl_depth.ros.clouds import read_map\n"
        "from sphere_nav.params import build\n"
        f"cloud = read_map({str(folder)!r}, build(MclDepthParams, {settings!r}))\n"
        "of_readers = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024.0\n"
        "print(max(peak_mb(), of_readers), len(cloud))\n"
    )
    started = time.monotonic()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    megabytes, count = done.stdout.split()
    return time.monotonic() - started, float(megabytes), int(count)


def peak_mb() -> float:
    """Return the most memory that this process has had, MB; getrusage would tell that of who started it, too."""
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return float(next(line for line in lines if line.startswith("VmHWM")).split()[1]) / 1024.0
