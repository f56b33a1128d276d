"""Real panoramas in a bare floor plan: the visual compass, and where the true place ranks among all places."""

from __future__ import annotations

import argparse
import csv
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from matplotlib.path import Path as Polygon
from numpy.typing import NDArray

from benchmarks.machine import describe
from benchmarks.report import Bound, Report, Table
from mcl_depth.geometry.files import read_geometry
from mcl_depth.geometry.floor_plan import WallSurface, read_surfaces, rings_of
from mcl_depth.geometry.synthesis import DepthSynthesizer
from mcl_depth.likeness.comparison import (
    FeatureStack,
    depth_features_many,
    heading,
    num_alpha_for,
    similarity_many,
    visual_features,
)
from mcl_depth.likeness.level_view import level_view
from mcl_depth.params import ComparisonParams, SynthesisParams
from sphere_nav.geometry import Spherical

HELP = "real panoramas in a floor plan: compass at the true places, scan of all places"
GRID = 0.5  # m
NEAR = 0.75  # m, of the true place


@dataclass(frozen=True)
class Shot:
    """One panorama: its level grey image, place (3,) in m and heading in rad in the axes of the plan."""

    name: str
    gray: NDArray[np.float32]
    place: NDArray[np.float64]
    yaw: float


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("--panoramas", type=Path, default=Path("../shared/data/panoramas_in_floor_plan"))


def run(options: argparse.Namespace) -> Report:
    """Measure compass and scan, at the default resolution and at twice that."""
    report = Report("mcl_panoramas", notes=[describe(options.threads)])
    if not options.panoramas.is_dir():
        report.skipped = f"no folder {options.panoramas}"
        return report
    rows = []
    for columns in (180,) if options.quick else (180, 360):
        figures = Scene(options.panoramas, SynthesisParams(num_columns=columns)).judge(ComparisonParams())
        rows.append((f"{360 / columns:g} deg a column", *(f"{value:.3g}" for value in figures.values())))
        if columns == SynthesisParams().num_columns:
            report.bounds += bounds(figures)
    report.tables.append(Table("Panoramas", ("resolution", *figures), rows))
    return report


def bounds(figures: dict[str, float]) -> list[Bound]:
    """Set the figures of the default beside those to reach."""
    return [
        Bound("compass, step 2 deg, within 10 deg", 85.0, figures["1 deg: within 10"], "%", is_minimum=True),
        Bound("compass, step 2 deg, within 5 deg", 80.0, figures["within 5"], "%", is_minimum=True),
        Bound("compass, step 2 deg, median", 2.0, figures["median deg"], "deg"),
        Bound("compass, step 10 deg, within 10 deg", 80.0, figures["10 deg: within 10"], "%", is_minimum=True),
        Bound("scan, true place among the best 5 %", 80.0, figures["scan: in best 5 %"], "%", is_minimum=True),
        Bound("scan, median rank", 1.0, figures["median rank %"], "%"),
    ]


class Scene:
    """The plan drawn once at the true places and on the grid; only the comparison differs between variants."""

    def __init__(self, folder: Path, params: SynthesisParams) -> None:
        plan = folder / "surfaces.csv"
        self.synthesizer = DepthSynthesizer(read_geometry(plan), params)
        self.shots = read_shots(folder, self.synthesizer.camera)
        self.cells = grid_of(plan, height=float(self.shots[0].place[2]))
        self.true_ranges = self.synthesizer.synthesize_many(np.stack([shot.place for shot in self.shots]))
        self.cell_ranges = self.synthesizer.synthesize_many(self.cells)

    def judge(self, params: ComparisonParams) -> dict[str, float]:
        """Return the figures of one variant."""
        there, cells = (depth_features_many(ranges, params) for ranges in (self.true_ranges, self.cell_ranges))
        fine, coarse = (self.errors(there, step) for step in (self.finest_step(), 10.0))
        ranks = np.array([self.rank(shot, cells) for shot in self.shots])
        return {
            "1 deg: within 10": 100 * float(np.mean(fine <= 10)),
            "within 5": 100 * float(np.mean(fine <= 5)),
            "median deg": float(np.median(fine)),
            "10 deg: within 10": 100 * float(np.mean(coarse <= 10)),
            "scan: in best 5 %": 100 * float(np.mean(ranks <= 5)),
            "median rank %": float(np.median(ranks)),
        }

    def finest_step(self) -> float:
        """Return one column in degrees."""
        return max(1.0, 360.0 / self.synthesizer.camera.width)

    def errors(self, there: FeatureStack, step_deg: float) -> NDArray[np.float64]:
        """Return the error of the compass at the true places in degrees."""
        found = []
        for i, shot in enumerate(self.shots):
            s = similarity_many(visual_features(shot.gray), there, num_alpha_for(step_deg), np.array([i]))[0]
            off = heading(s).yaw - shot.yaw
            found.append(abs(np.degrees(np.arctan2(np.sin(off), np.cos(off)))))
        return np.array(found)

    def rank(self, shot: Shot, cells: FeatureStack) -> float:
        """Return the place of the best cell near the truth among all cells, in percent of them."""
        best = similarity_many(visual_features(shot.gray), cells, 36).max(axis=1)
        near = np.linalg.norm(self.cells[:, :2] - shot.place[:2], axis=1) <= NEAR
        return 100.0 * float(np.mean(best > best[near].max())) if near.any() else 100.0


def read_shots(folder: Path, window: Spherical) -> list[Shot]:
    """Return the panoramas with their truth.

    In a panorama's own frame y points at the centre column and atan2(-x, y) grows to the right of the image.
    """
    shots = []
    with (folder / "poses.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(line for line in file if not line.startswith("#")):
            image = cv2.imread(str(folder / "images" / row["image"]), cv2.IMREAD_GRAYSCALE)
            if image is None:
                raise ValueError(f"{folder / 'images' / row['image']}: expected an image, found none")
            is_mirrored, yaw = to_plan(np.radians(float(row["rotation_deg"])))
            image = np.ascontiguousarray(image[:, ::-1] if is_mirrored else image)
            gray, _ = level_view(image, Spherical(image.shape[1], image.shape[0]), np.eye(3), window)
            place = np.array([float(row["x_m"]), float(row["y_m"]), float(row["camera_height_m"])])
            shots.append(Shot(row["image"], gray, place, yaw))
    return shots


def to_plan(rotation: float) -> tuple[bool, float]:
    """Return whether the panorama is mirrored in the plan's axes, and the heading of its centre column."""
    turn = np.array([[np.cos(rotation), np.sin(rotation)], [-np.sin(rotation), np.cos(rotation)]])
    center = np.array([0.0, 1.0]) @ turn  # u at the middle: atan2(-x, y) = 0
    right = np.array([-1.0, 0.0]) @ turn  # u beyond the middle: atan2(-x, y) > 0
    is_mirrored = bool(
        center[0] * right[1] - center[1] * right[0] > 0
    )  # what is right in the image is left in the plan
    return is_mirrored, float(np.arctan2(center[1], center[0]))


def grid_of(plan: Path, height: float) -> NDArray[np.float64]:
    """Return places (N, 3) on a grid over all rooms of the plan."""
    walls: dict[str, list[WallSurface]] = {}
    for surface in read_surfaces(plan):
        if surface.kind == "wall":
            walls.setdefault(surface.room, []).append(surface)
    rings = [ring for room in walls.values() for ring in rings_of(room)]
    corners = np.concatenate(rings)
    x, y = (np.arange(corners[:, i].min(), corners[:, i].max(), GRID) for i in (0, 1))
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    places = places[np.any([Polygon(ring).contains_points(places) for ring in rings], axis=0)]
    return np.column_stack([places, np.full(len(places), height)])
