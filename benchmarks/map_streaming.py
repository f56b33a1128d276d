"""A walk of 1 km at 10 m/s past 300 key spheres of 2048 x 1024, read from the map as they are needed.

A thread tracks the camera, as the localiser does with every image: choose references, align, look ahead; others read,
prepare and choose pixels. It waits where the time that this takes is not its own. The place is a corridor whose walls
repeat from key sphere to key sphere, so that one picture serves them all and ten images the whole walk.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.corridor import SPACING_M, render
from benchmarks.machine import describe
from benchmarks.report import Bound, Report, Table
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.ros.maps.reader import save_map
from sphere_nav.spheres.appearance.features import features_of_sphere
from sphere_nav.spheres.appearance.index import AppearanceIndex
from sphere_nav.spheres.graph import KeySphere, SphereGraph
from sphere_nav.spheres.sphere import Sphere

HELP = "300 key spheres past a camera at 10 m/s: memory, waits, load and prepare"
SPHERE = Spherical(2048, 1024)
NUM_SPHERES = 300
PATIENCE_S = 900.0
GRAIN = 2.0  # standard deviation of the pictures' noise in grey levels: PNG cannot shrink it
WALK = "benchmarks.map_streaming_walk"


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Nothing to choose."""


def run(options: argparse.Namespace) -> Report:
    """Write the map, walk through it in a process of its own."""
    number = 30 if options.quick else NUM_SPHERES
    with tempfile.TemporaryDirectory() as folder:
        path = _make_map(Path(folder), number)
        megabytes = sum(file.stat().st_size for file in path.iterdir()) / 1e6 / number
        command = [sys.executable, "-m", WALK, str(path)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
        if done.returncode:
            raise ValueError(f"walk: expected exit code 0, found {done.returncode}: {done.stderr[-500:]}")
        found = json.loads(done.stdout.splitlines()[-1])
    report = Report("map_streaming", notes=[describe(options.threads), __doc__ or ""])
    rows = [(name, f"{value:.4g}") for name, value in found.items()]
    report.tables.append(Table(f"{number} key spheres, {SPACING_M * number:.0f} m", ("what", "found"), rows))
    report.bounds = [
        Bound("walk of 1 km at 10 m/s past 300 key spheres, largest resident memory", 400.0, found["rss_mb"], "MB"),
        Bound("the same, longest wait of the tracking thread", 2.0, found["wait_ms"], "ms"),
        Bound("the same, images aligned to small key spheres, none being ready", 0.0, found["num_coarse"], ""),
        Bound("load and prepare a key sphere 2048 x 1024, CPU, median", 60.0, found["prepare_ms"], "ms"),
        Bound("key sphere 2048 x 1024, colour and range, in the map", 10.0, megabytes, "MB"),
    ]
    return report


def _make_map(folder: Path, number: int) -> Path:
    """Write a map of one picture under many ids."""
    gray, range_m = render(SPHERE, SE3.identity())
    rng = np.random.default_rng(0)
    color = np.clip(gray[..., None] * [1.0, 0.9, 0.8] + rng.normal(0.0, GRAIN, (*gray.shape, 3)), 1, 255)
    sphere = Sphere(color.astype(np.uint8), range_m, SPHERE, 1)
    features = features_of_sphere(sphere)
    nodes = [KeySphere(i, i + 1, SE3.from_planar(SPACING_M * i, 0.0, 0.0)) for i in range(number)]
    appearance = AppearanceIndex()
    for node in nodes:
        appearance.add(node.id, features)
    return save_map(folder / "map", SphereGraph(nodes), load_sphere=lambda _: sphere, appearance=appearance)
