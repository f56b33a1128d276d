"""Length of a straight leg of 100 m in maps of six cameras, by the true one: a bias of range shows as one of scale.

The simulator's rigs go along the first street of the city, a sphere a metre: rendered, stitched, placed by the mapper.
The scale of a map is the distance between its first and last sphere by the true one, less one; it has a sign. Nothing
was chosen on these seeds.
"""

from __future__ import annotations

import argparse

import numpy as np

from benchmarks.machine import describe
from benchmarks.report import Bound, Report, Table
from cycab_sim.params import SimParams
from cycab_sim.sensors.rigs import rig_place
from cycab_sim.simulator import Simulator
from sphere_mapping.acquisition.params import StitchParams
from sphere_mapping.acquisition.stitching.stitcher import Stitcher
from sphere_mapping.mapper import Mapper
from sphere_mapping.params import MapperParams
from sphere_nav.params import build

HELP = "scale of a straight leg of 100 m in maps of both rigs, over seeds of the city"
KINDS = ("ring", "vertical")
BEGIN, LENGTH, QUICK_LENGTH, SPACING = 20.0, 100.0, 6.0, 1.0  # m of the tour
MAX_SCALE = 0.05  # %


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--leg-seeds", type=int, default=5, help="cities to drive through (%(default)s)")
    parser.add_argument("--first-leg-seed", type=int, default=301, help="seed of the first of them (%(default)s)")
    parser.add_argument("--leg-width", type=int, default=1024, help="columns of a sphere (%(default)s)")


def run(options: argparse.Namespace) -> Report:
    """Map each leg with both rigs."""
    seeds = range(options.first_leg_seed, options.first_leg_seed + (1 if options.quick else options.leg_seeds))
    length = QUICK_LENGTH if options.quick else LENGTH
    report, rows = Report("leg_scale", notes=[describe(options.threads), __doc__ or ""]), []
    for kind in KINDS:
        found = [drive(kind, seed, length, options.leg_width) for seed in seeds]
        rows += [(kind, str(seed), f"{s:+.3f}", f"{aside:.1f}") for seed, (s, aside) in zip(seeds, found, strict=True)]
        mean = float(np.mean([scale for scale, _ in found]))
        what = f"{kind}: scale of a leg of {length:.0f} m, mean of {len(seeds)} seeds from {seeds[0]}"
        report.bounds.append(Bound(what, MAX_SCALE, abs(mean), "%"))
    columns = ("rig", "seed", "map by truth, less 1 [%]", "beside the line at the end [mm]")
    report.tables.append(Table("Scale of a straight leg", columns, rows))
    return report


def drive(kind: str, seed: int, length: float, width: int) -> tuple[float, float]:
    """Return the scale's error in % of a leg mapped by a rig, and how far beside the true line its end lies in mm.

    Raises:
        RuntimeError: The mapper could not place the last sphere.
    """
    values = {"world": "city", "seed": seed, "noise_seed": seed, "sphere.width": 0}
    size = f"{width * 17 // 32},{width * 17 // 32}"
    simulator = Simulator(build(SimParams, values | {"rig.kind": kind, "rig.size": size}))
    assert simulator.rig is not None
    stitcher, mapper = Stitcher(simulator.rig, build(StitchParams, {"width": width})), Mapper(MapperParams())
    placed, truth, place = [], [], rig_place(simulator.params.rig) @ stitcher.T_rig_sphere
    for index in range(int(length / SPACING) + 1):
        x, y, yaw, _ = simulator.path.at(BEGIN + SPACING * index).tolist()
        simulator.teleport(x, y, yaw)
        images = {name: frame.image for name, frame in simulator.capture_rig().items()}
        placed.append(mapper.add(stitcher.stitch(images, index + 1).sphere).T_map_sphere)
        truth.append(simulator.T_world_base @ place)
    first, last = placed[0], placed[-1]
    if first is None or last is None:
        raise RuntimeError(f"{kind}, seed {seed}: expected the last sphere in the map, found it not placed")
    return compare((first.inverse() @ last).translation, (truth[0].inverse() @ truth[-1]).translation)


def compare(found: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    """Return the error of a displacement's (3,) length in %, and its distance in mm from the true line."""
    length = float(np.linalg.norm(true))
    along = float(found @ true) / length
    aside = float(np.linalg.norm(found - along * true / length))
    return 100.0 * (float(np.linalg.norm(found)) / length - 1.0), 1000.0 * aside
