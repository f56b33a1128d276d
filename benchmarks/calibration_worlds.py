"""Rigs of known calibration before boards, projected with noise or rendered: errors beside what the report promises."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np

from benchmarks.board_world import BoardWorld, boards_around, ring_rig, vertical_rig, wandering
from benchmarks.report import Bound, Report, Table
from rig_calibration.boards.detect import detect_all
from rig_calibration.boards.views import BoardView
from rig_calibration.calibrate import Calibration, CameraSpec, calibrate
from rig_calibration.params import CalibrationParams
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.rig import Rig

RIGS: dict[str, Callable[[], Rig]] = {"vertical": vertical_rig, "ring": ring_rig}
NUM_BOARDS, DISTANCE_M = 6, 1.5
PROJECTED_INSTANTS, RENDERED_INSTANTS, DRIVEN_INSTANTS = 60, 24, 20
NOISE_PX = 0.1
MAX_POSITION_MM, MAX_ROTATION_DEG = 0.5, 0.02
MEDIAN_CHI2_6 = 5.348
COLUMNS = (
    "what",
    "seed",
    "corners",
    "noise in px",
    "held out in px",
    "worst in mm",
    "worst in deg",
    "std in mm",
    "std in deg",
    "NEES / 6",
    "halves in mm",
    "halves in deg",
    "left out",
)


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
        position, rotation = np.linalg.norm(self.errors[:, :3], axis=1), np.linalg.norm(self.errors[:, 3:], axis=1)
        return 1e3 * float(position.max()), float(np.degrees(rotation.max()))

    @property
    def nees(self) -> Array:
        """Squared error by the covariance of the report (C,): 6 on average if that is right."""
        covariance = self.found.spread.poses[1:]
        found: Array = np.einsum("ci,ci->c", self.errors, np.linalg.solve(covariance, self.errors[..., None])[..., 0])
        return found

    @property
    def row(self) -> tuple[str, ...]:
        """Cells of `COLUMNS`."""
        std, halves = self.found.spread.pose_std[1:], self.found.validation.halves[1:]
        parts = [
            f"{1e3 * np.linalg.norm(std[:, :3], axis=1).max():.2f}",
            f"{np.degrees(np.linalg.norm(std[:, 3:], axis=1).max()):.4f}",
            f"{self.nees.mean() / 6.0:.2f}",
            f"{1e3 * np.linalg.norm(halves[:, :3], axis=1).max():.2f}",
            f"{np.degrees(np.linalg.norm(halves[:, 3:], axis=1).max()):.4f}",
        ]
        corners, noise = np.count_nonzero(self.found.kept), self.found.spread.noise_px
        held_out = float(np.max(self.found.validation.held_out_px))
        worst = (f"{self.worst[0]:.2f}", f"{self.worst[1]:.4f}")
        left_out = str(len(self.found.dropped))
        return (self.what, str(self.seed), f"{corners}", f"{noise:.3f}", f"{held_out:.3f}", *worst, *parts, left_out)


def projected(report: Report, num_seeds: int) -> None:
    """Corners projected with known noise, for many seeds: is the scatter what the report promises?"""
    for name in RIGS:
        trials = [_projected_trial(name, seed) for seed in range(num_seeds)]
        _add(report, trials, f"{name} rig, corners projected with {NOISE_PX} px of noise", is_nees_bound=True)


def rendered(report: Report, num_seeds: int, num_workers: int) -> None:
    """Images, through detection."""
    for name, kind in (("vertical", "charuco"), ("ring", "charuco"), ("vertical", "chessboard")):
        trials = [_rendered_trial(name, kind, seed, num_workers) for seed in range(num_seeds)]
        _add(report, trials, f"{name} rig, rendered {kind}s", is_nees_bound=False)


def driven(report: Report) -> None:
    """A vertical rig that only drives on a flat floor: the axes that this leaves open are named, no others."""
    rng = np.random.default_rng(0)
    boards, poses = boards_around(NUM_BOARDS, DISTANCE_M, rng)
    world = BoardWorld(vertical_rig(), boards, poses, wandering(DRIVEN_INSTANTS, rng, is_drive_only=True))
    found = _calibrated(world, world.views(NOISE_PX, rng), is_lens_known=True)
    report.notes += [f"drive only: {line}" for line in found.warnings]
    named = [line for line in found.warnings if "cannot be observed" in line or "weakly observed" in line]
    report.bounds.append(Bound("drive only: lines that name an axis", 1.0, float(len(named)), "", is_minimum=True))


def _add(report: Report, trials: list[Trial], title: str, *, is_nees_bound: bool) -> None:
    report.tables.append(Table(title, COLUMNS, [trial.row for trial in trials]))
    worst = np.array([trial.worst for trial in trials])
    report.bounds.append(Bound(f"{title}: worst position of all", MAX_POSITION_MM, float(worst[:, 0].max()), "mm"))
    report.bounds.append(Bound(f"{title}: worst rotation of all", MAX_ROTATION_DEG, float(worst[:, 1].max()), "deg"))
    per_seed = np.array([trial.nees.mean() / 6.0 for trial in trials])
    if is_nees_bound:
        median = float(np.median(np.concatenate([trial.nees for trial in trials]))) / MEDIAN_CHI2_6
        told = f"{per_seed.mean():.2f} in the mean of {len(trials)} seeds ({median:.2f} by medians)"
        report.notes.append(f"{title}: NEES / 6 {told}")
        report.bounds.append(Bound(f"{title}: NEES / 6, mean", 1.5, float(per_seed.mean()), ""))
        report.bounds.append(Bound(f"{title}: NEES / 6, mean", 0.67, float(per_seed.mean()), "", is_minimum=True))
    else:
        report.notes.append(f"{title}: NEES / 6 {per_seed.mean():.2f} in the mean of {len(trials)} seeds")


def _projected_trial(name: str, seed: int) -> Trial:
    rng = np.random.default_rng([seed, 17])
    boards, poses = boards_around(NUM_BOARDS, DISTANCE_M, rng)
    world = BoardWorld(RIGS[name](), boards, poses, wandering(PROJECTED_INSTANTS, rng))
    return _trial(name, seed, world, world.views(NOISE_PX, rng), is_lens_known=True)


def _rendered_trial(name: str, kind: str, seed: int, num_workers: int) -> Trial:
    rng = np.random.default_rng([seed, 23])
    boards, poses = boards_around(NUM_BOARDS, DISTANCE_M, rng, kind)
    world = BoardWorld(RIGS[name](), boards, poses, wandering(RENDERED_INSTANTS, rng))
    with ProcessPoolExecutor(num_workers) as pool:
        cameras = range(len(world.rig.cameras))
        seen = pool.map(_seen, [world] * len(cameras), cameras, [seed] * len(cameras))
        views = [view for views_of_camera in seen for view in views_of_camera]
    return _trial(f"{name} {kind}", seed, world, views)


def _seen(world: BoardWorld, camera: int, seed: int) -> list[BoardView]:
    """Return what is detected in all images of one camera."""
    return list(_detections(world, camera, np.random.default_rng([seed, camera, 29])))


def _detections(world: BoardWorld, camera: int, rng: np.random.Generator) -> Iterator[BoardView]:
    for instant in range(len(world.T_world_rig.matrix)):
        image = world.render(camera, instant, rng)
        for board, (corners, pixels) in detect_all(image, world.boards).items():
            yield BoardView(world.rig.cameras[camera].name, f"{instant:03d}", board, corners, pixels)


def _trial(what: str, seed: int, world: BoardWorld, views: list[BoardView], *, is_lens_known: bool = False) -> Trial:
    found = _calibrated(world, views, is_lens_known)
    pairs = zip(found.rig.cameras[1:], world.rig.cameras[1:], strict=True)
    errors = []
    for mine, truth in pairs:
        R, xi = truth.T_rig_camera.rotation, (truth.T_rig_camera.inverse() @ mine.T_rig_camera).log()
        errors.append(np.concatenate([R @ xi[:3], R @ xi[3:]]))
    return Trial(what, seed, found, np.stack(errors))


def _calibrated(world: BoardWorld, views: list[BoardView], is_lens_known: bool) -> Calibration:
    """Calibrate; a lens that is known to start from saves the search for one, and changes nothing else."""
    specs = [
        CameraSpec(part.name, lens.model, (lens.width, lens.height), lens if is_lens_known else None)
        for part in world.rig.cameras
        for lens in (part.camera,)
    ]
    return calibrate(specs, world.boards, views, CalibrationParams(), world.rig.cameras[0].T_rig_camera)
