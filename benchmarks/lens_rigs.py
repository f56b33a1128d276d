"""Whether images of another lens than the rig file says are refused, and right ones are not: simulated rigs."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import replace

import cv2

from benchmarks.machine import describe
from benchmarks.range_worlds import make_scene
from benchmarks.report import Bound, Report, Table
from cycab_sim.params import SimParams
from cycab_sim.simulator import Simulator
from sphere_mapping.acquisition.range.lens_check import LensEvidence, weigh_lenses
from sphere_mapping.acquisition.range.semi_global import Image
from sphere_nav.geometry import Fisheye, Pinhole, Rig
from sphere_nav.params import build

HELP = "rigs whose images fit their file, and whose do not: how often each is refused"
WIDTH = 544  # px, of each camera
KINDS = ("vertical", "ring")
LENSES: dict[str, dict[str, object]] = {
    "fisheye of 190 deg": {"model": "fisheye", "view_deg": 190.0},
    "pinhole of 100 deg": {"model": "pinhole", "view_deg": 100.0},
}


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Say which rooms and towns are seen."""
    parser.add_argument(
        "--lens-seeds", type=int, nargs="+", default=list(range(301, 305)), help="rooms and towns (%(default)s)"
    )


def run(options: argparse.Namespace) -> Report:
    """Count refusals of right rig files, of files of the other lens model, and of exchanged cameras."""
    seeds = options.lens_seeds[:1] if options.quick else options.lens_seeds
    found: dict[str, list[LensEvidence]] = {}
    for seed in seeds:
        for kind in KINDS:
            for lens in LENSES:
                for rig, images in (_in_room(seed, kind, lens), _in_town(seed, kind, lens)):
                    for what, file, seen in _readings(rig, images, lens):
                        found.setdefault(what, []).append(weigh_lenses(file, seen))
    rows = [_row(what, evidence) for what, evidence in found.items()]
    columns = (
        "rig file",
        "rigs",
        "with enough features",
        "refused",
        "least of the file's share",
        "most of other's by it",
    )
    right = found["right"]
    wrong = [one for what, some in found.items() if what.startswith("other model") for one in some if one.is_enough]
    bounds = [
        Bound(f"right rig files refused, of {len(right)}", 0.0, _share_refused(right), ""),
        Bound(f"files of the other lens model refused, of {len(wrong)}", 0.95, _share_refused(wrong), "", True),
    ]
    table = Table("Rig files against images", columns, rows)
    return Report("lens_rigs", [table], bounds, [describe(options.threads), f"rooms and towns {seeds}"])


def _row(what: str, evidence: list[LensEvidence]) -> tuple[str, ...]:
    enough = [one for one in evidence if one.is_enough]
    least = min((one.given for one in enough), default=float("nan"))
    most = max((one.other / max(one.given, 1e-3) for one in enough), default=float("nan"))
    refused = sum(bool(one.reason) for one in evidence)
    return (what, str(len(evidence)), str(len(enough)), str(refused), f"{least:.2f}", f"{most:.2f}")


def _share_refused(evidence: list[LensEvidence]) -> float:
    return sum(bool(one.reason) for one in evidence) / len(evidence)


def _in_room(seed: int, kind: str, lens: str) -> tuple[Rig, dict[str, Image]]:
    scene = make_scene(seed, kind, WIDTH * 32 // 17, LENSES[lens])
    return scene.rig, {name: cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for name, image in scene.images.items()}


def _in_town(seed: int, kind: str, lens: str) -> tuple[Rig, dict[str, Image]]:
    values = {"rig.kind": kind, "seed": seed} | {f"rig.{name}": value for name, value in LENSES[lens].items()}
    simulator = Simulator(build(SimParams, values))
    assert simulator.rig is not None
    frames = simulator.capture_rig()
    return simulator.rig, {name: cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY) for name, frame in frames.items()}


def _readings(rig: Rig, images: Mapping[str, Image], lens: str) -> list[tuple[str, Rig, Mapping[str, Image]]]:
    """Return the right file, one that takes the lens for another, and images that have got to other cameras."""
    model = Pinhole if "fisheye" in lens else Fisheye
    parts = []
    for part in rig.cameras:
        fx, fy, cx, cy = (float(value) for value in part.camera.coefficients[:4])
        parts.append(replace(part, camera=model(part.camera.width, part.camera.height, fx, fy, cx, cy)))
    names = list(images)
    exchanged = {name: images[other] for name, other in zip(names, names[1:] + names[:1], strict=True)}
    return [
        ("right", rig, images),
        (f"other model than {lens}", replace(rig, cameras=tuple(parts)), images),
        (f"cameras exchanged, {lens}", rig, exchanged),
    ]
