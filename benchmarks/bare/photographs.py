"""Real photographs in bare geometry: panoramas of a home in its floor plan, six cameras of a car in a LiDAR sweep.

The visual compass at the true places, where the true place ranks among all places of the plan, and how far the best
place and heading around a car are off; its mirrored photographs must fit somewhere else.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np
from matplotlib.path import Path as Polygon
from numpy.typing import NDArray

from benchmarks.bare.homes import HEIGHT, Place, read_places
from benchmarks.mapping.rigs import nuscenes
from benchmarks.report import Bound, Headline, Report
from mcl_depth.geometry.cloud import cloud_from_points
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
from sphere_nav.geometry.arrays import Array

HELP = "real panoramas in a floor plan, six cameras of a car in a LiDAR sweep: compass, rank, peak"
GRID, NEAR = 0.5, 0.75  # m: of the places of a plan; of the true place
REACH, STEP, TURN = 5.0, 0.5, 30.0  # m, m, deg: tried around the car
NUM_COLUMNS = 720


def run(options: argparse.Namespace) -> Report:
    """Measure both."""
    report = Report("photographs", notes=[__doc__ or ""])
    for folder, measure in (("panoramas_in_floor_plan", _home), ("surround/nuscenes", _car)):
        if (options.data / folder).is_dir():
            report.bounds += measure(options.data / folder)
        else:
            report.notes.append(f"{folder}: skipped, not in {options.data}")
    return report


def _home(folder: Path) -> list[Bound]:
    plan, places = folder / "surfaces.csv", read_places(folder)
    synthesizer = DepthSynthesizer(read_geometry(plan), SynthesisParams())
    window, cells = synthesizer.camera, _grid_of(plan)
    there, everywhere = (
        depth_features_many(
            synthesizer.synthesize_many(np.column_stack([xy, np.full(len(xy), HEIGHT)])), ComparisonParams()
        )
        for xy in (np.array([place.pose[:2] for place in places]), cells)
    )
    grays = [level_view(place.image, Spherical(*place.image.shape[::-1]), np.eye(3), window)[0] for place in places]
    fine, coarse = (_compass(grays, places, there, step) for step in (360.0 / window.width, 10.0))
    ranks = np.array([_rank(gray, place, cells, everywhere) for gray, place in zip(grays, places, strict=True)])
    told = Headline("bare geometry", "16 panoramas of a real home", "N17: a panorama and a scanner")
    return [
        Bound("compass, a column, within 10 deg", 85.0, 100 * float(np.mean(fine <= 10)), "%", is_minimum=True),
        Bound("compass, a column, within 5 deg", 80.0, 100 * float(np.mean(fine <= 5)), "%", is_minimum=True),
        Bound("compass, a column, median", 2.0, float(np.median(fine)), "deg", headline=told),
        Bound("compass, step 10 deg, within 10 deg", 80.0, 100 * float(np.mean(coarse <= 10)), "%", is_minimum=True),
        Bound("true place among the best 5 %", 80.0, 100 * float(np.mean(ranks <= 5)), "%", is_minimum=True),
        Bound("median rank of the true place", 1.0, float(np.median(ranks)), "%"),
    ]


def _compass(grays: list[NDArray], places: list[Place], there: FeatureStack, step_deg: float) -> Array:
    """Return the error (N,) of the compass at the true places in degrees."""
    found = []
    for i, (gray, place) in enumerate(zip(grays, places, strict=True)):
        s = similarity_many(visual_features(gray), there, num_alpha_for(step_deg), np.array([i]))[0]
        off = heading(s).yaw - place.pose[2]
        found.append(abs(np.degrees(np.arctan2(np.sin(off), np.cos(off)))))
    return np.array(found)


def _rank(gray: NDArray, place: Place, cells: Array, everywhere: FeatureStack) -> float:
    """Return the place of the best cell near the truth among all cells, in percent of them."""
    best = similarity_many(visual_features(gray), everywhere, 36).max(axis=1)
    near = np.linalg.norm(cells - place.pose[:2], axis=1) <= NEAR
    return 100.0 * float(np.mean(best > best[near].max())) if near.any() else 100.0


def _grid_of(plan: Path) -> Array:
    """Return places (N, 2) on a grid over all rooms of the plan."""
    walls: dict[str, list[WallSurface]] = {}
    for surface in read_surfaces(plan):
        if surface.kind == "wall":
            walls.setdefault(surface.room, []).append(surface)
    rings = [ring for room in walls.values() for ring in rings_of(room)]
    corners = np.concatenate(rings)
    x, y = (np.arange(corners[:, i].min(), corners[:, i].max(), GRID) for i in (0, 1))
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return places[np.any([Polygon(ring).contains_points(places) for ring in rings], axis=0)]


def _car(folder: Path) -> list[Bound]:
    rig, images, points = nuscenes(folder)
    params = SynthesisParams(num_columns=NUM_COLUMNS, elevation_min_deg=-16.0, elevation_max_deg=16.0)
    synthesizer = DepthSynthesizer(cloud_from_points(points, "sweep"), params)
    window = synthesizer.camera
    gray, is_seen = np.zeros((window.height, window.width), np.float32), np.zeros((window.height, window.width), bool)
    for part in rig.cameras:
        image = cv2.cvtColor(images[part.name], cv2.COLOR_RGB2GRAY)
        seen_by, seen = level_view(image, part.camera, part.T_rig_camera.rotation, window)
        gray = np.where(seen & ~is_seen, seen_by, gray)
        is_seen |= seen
    center = np.mean([part.T_rig_camera.translation for part in rig.cameras], axis=0)
    steps = np.arange(-REACH, REACH + STEP / 2, STEP)
    offsets = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    ranges = synthesizer.synthesize_many(center + np.column_stack([offsets, np.zeros(len(offsets))]))
    stack = depth_features_many(ranges, ComparisonParams())
    turns = np.degrees(np.angle(np.exp(2j * np.pi * np.arange(NUM_COLUMNS) / NUM_COLUMNS)))
    found = []
    for step in (1, -1):
        s = similarity_many(visual_features(gray[:, ::step], is_seen[:, ::step]), stack, NUM_COLUMNS)
        place, turn = np.unravel_index(np.argmax(np.where(np.abs(turns) <= TURN, s, -np.inf)), s.shape)
        found.append((float(np.linalg.norm(offsets[place])), float(abs(turns[turn]))))
    (off, angle), (off_mirrored, angle_mirrored) = found
    return [
        Bound("six cameras of a car: peak off the true place", 1.0, off, "m"),
        Bound("six cameras of a car: peak off the true heading", 3.0, angle, "deg"),
        Bound("mirrored, must fail: of 1 m or 3 deg", 1.0, max(off_mirrored, angle_mirrored / 3.0), "x", True),
    ]
