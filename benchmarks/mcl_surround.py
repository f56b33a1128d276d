"""Six real cameras of a car as one panorama, in the cloud of one LiDAR sweep."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import describe
from benchmarks.report import Bound, Report
from mcl_depth.geometry.cloud import cloud_from_points
from mcl_depth.geometry.synthesis import DepthSynthesizer
from mcl_depth.likeness.comparison import depth_features_many, similarity_many, visual_features
from mcl_depth.likeness.level_view import level_view
from mcl_depth.params import ComparisonParams, SynthesisParams
from sphere_nav.geometry import Pinhole, Spherical

HELP = "six surround cameras as one panorama in a LiDAR sweep, against the mirrored photographs"
REACH, STEP = 5.0, 0.5  # m
TURN = 30.0  # deg
NUM_COLUMNS = 720


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("--surround", type=Path, default=Path("../shared/data/surround/nuscenes"))


def run(options: argparse.Namespace) -> Report:
    """Compare the panorama with every place and heading around the truth."""
    report = Report("mcl_surround", notes=[describe(options.threads)])
    if not options.surround.is_dir():
        report.skipped = f"no folder {options.surround}"
        return report
    params = SynthesisParams(num_columns=NUM_COLUMNS, elevation_min_deg=-16.0, elevation_max_deg=16.0)
    calibration = json.loads((options.surround / "calibration.json").read_text(encoding="utf-8"))
    synthesizer = DepthSynthesizer(cloud_from_points(sweep(options.surround, calibration), "sweep"), params)
    gray, is_seen, center = panorama(options.surround, calibration, synthesizer.camera)
    steps = np.arange(-REACH, REACH + STEP / 2, STEP)
    offsets = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    comparison = ComparisonParams()
    stack = depth_features_many(
        synthesizer.synthesize_many(center + np.column_stack([offsets, np.zeros(len(offsets))])), comparison
    )
    for name, image, seen in (("", gray, is_seen), ("mirrored, must fail: ", gray[:, ::-1], is_seen[:, ::-1])):
        s = similarity_many(visual_features(image, seen), stack, NUM_COLUMNS)
        turns = np.degrees(np.angle(np.exp(2j * np.pi * np.arange(NUM_COLUMNS) / NUM_COLUMNS)))
        s = np.where(np.abs(turns) <= TURN, s, -np.inf)
        place, turn = np.unravel_index(np.argmax(s), s.shape)
        off, angle = float(np.linalg.norm(offsets[place])), float(abs(turns[turn]))
        if not name:
            report.bounds.append(Bound("peak off the true place", 1.0, off, "m"))
            report.bounds.append(Bound("peak off the true heading", 3.0, angle, "deg"))
        else:
            miss = max(off / 1.0, angle / 3.0)
            report.bounds.append(Bound(f"{name}larger of place / 1 m, heading / 3 deg", 1.0, miss, "", True))
    report.notes.append(f"{is_seen.mean():.0%} of the panorama are seen, {len(offsets)} places")
    return report


def sweep(folder: Path, calibration: dict) -> NDArray[np.float64]:
    """Return the points (N, 3) in the axes of the car in m."""
    lidar = calibration["lidar"]
    points = np.fromfile(folder / lidar["file"], np.float32).reshape(-1, 5)[:, :3].astype(np.float64)
    points = points[np.linalg.norm(points[:, :2], axis=1) > 2.5]  # the car itself
    T_ego_lidar = np.array(lidar["lidar2ego"])
    return points @ T_ego_lidar[:3, :3].T + T_ego_lidar[:3, 3]


def panorama(
    folder: Path, calibration: dict, window: Spherical
) -> tuple[NDArray[np.float32], NDArray[np.bool_], NDArray[np.float64]]:
    """Return the level panorama of all cameras, which pixels they see, and the mean place of the cameras (3,) in m."""
    total = np.zeros((window.height, window.width), np.float32)
    is_seen = np.zeros(total.shape, np.bool_)
    places = []
    for camera in calibration["cameras"].values():
        image = cv2.imread(str(folder / camera["file"]), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise ValueError(f"{folder / camera['file']}: expected an image, found none")
        K, T_ego_camera = np.array(camera["K"]), np.array(camera["cam2ego"])
        model = Pinhole(image.shape[1], image.shape[0], K[0, 0], K[1, 1], K[0, 2], K[1, 2])
        gray, seen = level_view(image, model, T_ego_camera[:3, :3], window)
        total = np.where(seen & ~is_seen, gray, total)
        is_seen |= seen
        places.append(T_ego_camera[:3, 3])
    return total, is_seen, np.mean(places, axis=0)
