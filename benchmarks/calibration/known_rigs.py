"""Rigs of known calibration before boards, projected with noise or rendered: errors beside what the report promises.

A rig that only drives on a flat floor leaves axes open: those are named, no others.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np

from benchmarks.report import Bound, Headline, Report, Table
from cycab_sim.world.boards import BoardWorld, boards_around, ring_rig, vertical_rig, wandering
from rig_calibration.boards.board import Board
from rig_calibration.boards.detect import detect_all
from rig_calibration.boards.views import BoardView
from rig_calibration.calibrate import Calibration, CameraSpec, calibrate
from rig_calibration.params import CalibrationParams
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.rig import Rig

HELP = "calibration of known rigs, vertical and ring, before projected and rendered boards"
RIGS: dict[str, Callable[[], Rig]] = {"vertical": vertical_rig, "ring": ring_rig}
NUM_BOARDS, DISTANCE_M, NOISE_PX = 6, 1.5, 0.1
INSTANTS = {"projected": 60, "rendered": 24, "driven": 20}
COUNTS = {"quick": (2, 0), "full": (10, 4)}  # seeds of projected corners, of rendered images
MAX_POSITION_MM, MAX_ROTATION_DEG, NEES = 0.5, 0.02, (0.67, 1.5)
COLUMNS = ("rig", "seed", "corners", "held out px", "worst mm", "deg", "std mm", "deg", "NEES / 6", "left out")


@dataclass(frozen=True)
class Trial:
    """One calibration: errors (C, 6) along and about the axes of the rig, in m and rad, of all but the first camera."""

    what: str
    seed: int
    found: Calibration
    errors: Array

    @property
    def worst(self) -> tuple[float, float]:
        """Largest error of a camera, in mm and degrees."""
        return _largest(self.errors)

    @property
    def nees(self) -> float:
        """Squared error by the covariance of the report, a sixth: 1 on average if that is right."""
        covariance = self.found.spread.poses[1:]
        weighted = np.linalg.solve(covariance, self.errors[..., None])[..., 0]
        return float(np.einsum("ci,ci->c", self.errors, weighted).mean()) / 6.0

    @property
    def row(self) -> tuple[str, ...]:
        """Cells of `COLUMNS`."""
        corners, held_out = np.count_nonzero(self.found.kept), float(np.max(self.found.validation.held_out_px))
        numbers = (*self.worst, *_largest(self.found.spread.pose_std[1:]), self.nees)
        told = (f"{held_out:.3f}", *(f"{value:.3f}" for value in numbers), str(len(self.found.dropped)))
        return self.what, str(self.seed), str(corners), *told


def run(options: argparse.Namespace) -> Report:
    """Measure projected, rendered and driven rigs."""
    report = Report("known_rigs", notes=[__doc__ or ""])
    num_projected, num_rendered = COUNTS[options.size]
    for name in RIGS:
        trials = [_trial(name, "projected", "chessboard", options.seed + k) for k in range(num_projected)]
        _add(report, trials, f"{name} rig, corners projected with {NOISE_PX} px of noise")
    for name, kind in (("vertical", "charuco"), ("ring", "charuco"), ("vertical", "chessboard")):
        if num_rendered:
            trials = [_trial(name, "rendered", kind, options.seed + k) for k in range(num_rendered)]
            _add(report, trials, f"{name} rig, rendered {kind}s")
    found = _trial("vertical", "driven", "chessboard", options.seed).found
    named = [line for line in found.warnings if "cannot be observed" in line or "weakly observed" in line]
    report.notes += [f"drive only: {line}" for line in found.warnings]
    report.bounds.append(Bound("drive only: lines that name an axis", 1, len(named), "", is_minimum=True))
    return report


def _add(report: Report, trials: list[Trial], title: str) -> None:
    report.tables.append(Table(title, COLUMNS, [trial.row for trial in trials]))
    position, rotation = np.max([trial.worst for trial in trials], axis=0)
    told = Headline("map", "rigs of the simulator") if title.startswith("vertical rig, corners") else None
    report.bounds.append(Bound(f"{title}: worst position", MAX_POSITION_MM, float(position), "mm", headline=told))
    report.bounds.append(Bound(f"{title}: worst rotation", MAX_ROTATION_DEG, float(rotation), "deg"))
    if "projected" in title:
        mean = float(np.mean([trial.nees for trial in trials]))
        report.bounds += [Bound(f"{title}: NEES / 6", limit, mean, "", limit < 1.0) for limit in NEES]


def _trial(name: str, how: str, kind: str, seed: int) -> Trial:
    rng = np.random.default_rng([seed, 17])
    boards, poses = boards_around(Board, NUM_BOARDS, DISTANCE_M, rng, kind)
    way = wandering(INSTANTS[how], rng, is_drive_only=how == "driven")
    world = BoardWorld(RIGS[name](), boards, poses, way)
    views = _detected(world, seed) if how == "rendered" else world.views(BoardView, NOISE_PX, rng)
    specs = [
        CameraSpec(part.name, lens.model, (lens.width, lens.height), None if how == "rendered" else lens)
        for part in world.rig.cameras  # a lens that is known to start from saves the search, and changes nothing else
        for lens in (part.camera,)
    ]
    found = calibrate(specs, world.boards, views, CalibrationParams(), world.rig.cameras[0].T_rig_camera)
    errors = []
    for mine, truth in zip(found.rig.cameras[1:], world.rig.cameras[1:], strict=True):
        R, xi = truth.T_rig_camera.rotation, (truth.T_rig_camera.inverse() @ mine.T_rig_camera).log()
        errors.append(np.concatenate([R @ xi[:3], R @ xi[3:]]))
    return Trial(f"{name} {kind}", seed, found, np.stack(errors))


def _detected(world: BoardWorld, seed: int) -> list[BoardView]:
    with ProcessPoolExecutor(2) as pool:
        cameras = range(len(world.rig.cameras))
        return [
            view for seen in pool.map(_seen, [world] * len(cameras), cameras, [seed] * len(cameras)) for view in seen
        ]


def _seen(world: BoardWorld, camera: int, seed: int) -> list[BoardView]:
    """Return what is detected in all images of one camera."""
    return list(_detections(world, camera, np.random.default_rng([seed, camera, 29])))


def _detections(world: BoardWorld, camera: int, rng: np.random.Generator) -> Iterator[BoardView]:
    for instant in range(len(world.T_world_rig.matrix)):
        image = world.render(camera, instant, rng)
        for board, (corners, pixels) in detect_all(image, world.boards).items():
            yield BoardView(world.rig.cameras[camera].name, f"{instant:03d}", board, corners, pixels)


def _largest(errors: Array) -> tuple[float, float]:
    """Return the longest of errors (C, 6) in mm and degrees."""
    position, rotation = np.linalg.norm(errors[:, :3], axis=1), np.linalg.norm(errors[:, 3:], axis=1)
    return 1e3 * float(position.max()), float(np.degrees(rotation.max()))
