"""One real camera of a car in one sweep of a LiDAR: eq. 2, the correlation of gradients, and each image mirrored.

Every frame has a sweep of its own. The photograph is compared with depth images drawn around the true place, at all
headings. Frames of one drive resemble each other, so p of neighbouring frames is too small rather than too large.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import scipy.fft
from numpy.typing import NDArray
from scipy.stats import wilcoxon

from benchmarks.machine import describe
from benchmarks.mcl_surround import sweep
from benchmarks.report import Bound, Report, Table
from mcl_depth.geometry.cloud import cloud_from_points
from mcl_depth.geometry.synthesis import DepthSynthesizer
from mcl_depth.likeness.comparison import depth_features, depth_features_many, similarity_many, visual_features
from mcl_depth.likeness.features import GradientFeatures
from mcl_depth.likeness.level_view import level_view
from mcl_depth.likeness.partial_filter import double_gradients
from mcl_depth.params import ComparisonParams, SynthesisParams
from sphere_nav.geometry import Pinhole
from sphere_nav.geometry.arrays import Array

HELP = "one camera of a car in one LiDAR sweep: eq. 2, correlation, mirrored photographs, Wilcoxon's p"
SYNTHESIS = SynthesisParams(num_columns=720, elevation_min_deg=-16.0, elevation_max_deg=16.0)
REACH, STEP = 5.0, 1.25  # m, of the places around the true one
CAR = 2.5  # m, within which points are of the car itself
NEAR_DEG, OTHER_DEG = 1.0, 5.0  # a heading of the true place that counts as true; from where on as another one
COMPASS_DEG = 3.0
MIN_SHARE = 0.05  # of the largest energy in view: a view of nothing has that much
MIN_FRAMES = 20  # of which a p is asked
LIKENESSES = ("eq. 2", "correlation", "correlation where measured")


@dataclass(frozen=True)
class Frame:
    """A photograph (h, w) u1, its camera, points (N, 3) m in level axes, and where the camera is in them (4, 4)."""

    name: str
    image: NDArray[np.uint8]
    camera: Pinhole
    points: Array
    T_level_camera: Array


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments; the surround cameras are those of mcl_surround."""
    parser.add_argument(
        "--street", type=Path, metavar="DIR", help="also image_2/, velodyne/ and calib.txt or calib/ of a drive (KITTI)"
    )
    parser.add_argument("--every", type=int, default=1, metavar="N", help="every Nth of its frames (1)")


def run(options: argparse.Namespace) -> Report:
    """Compare every frame by every likeness, as it is and mirrored."""
    report = Report("mcl_street", notes=[describe(options.threads)])
    for title, frames in (("Surround cameras", _surround(options.surround)), ("Drive", _drive(options))):
        found = np.array([measure(frame) for frame in frames])  # (F, likeness, mirrored, figure)
        if len(found):
            rows = [_row(name, found[:, i], found[:, 0, 0]) for i, name in enumerate(LIKENESSES)]
            head = ("likeness", "stands out", "mirrored", f"heading within {COMPASS_DEG:g} deg", "mirrored",
                    "fits better elsewhere", "mirrored", "p not above its mirrored", "p not above eq. 2")  # fmt: skip
            report.tables.append(Table(f"{title}: {len(found)} frames, standard deviations, medians", head, rows))
        if len(found) >= MIN_FRAMES:
            report.bounds += [
                Bound(
                    f"{title}: where measured not above its mirrored, p", 0.01, _p(found[:, 2, 0], found[:, 2, 1]), ""
                ),
                Bound(f"{title}: where measured not above eq. 2, p", 0.01, _p(found[:, 2, 0], found[:, 0, 0]), ""),
            ]
    if not report.tables:
        report.skipped = f"no folder {options.surround}, and no --street"
    return report


def measure(frame: Frame) -> Array:
    """Return figures (likeness, 2, 3) of a frame and its mirror image: see `figures`."""
    synthesizer = DepthSynthesizer(cloud_from_points(frame.points, frame.name), SYNTHESIS)
    gray, seen = level_view(frame.image, frame.camera, frame.T_level_camera[:3, :3], synthesizer.camera)
    offsets = _offsets()
    places = frame.T_level_camera[:3, 3] + np.column_stack([offsets, np.zeros(len(offsets))])
    ranges = synthesizer.synthesize_many(places)
    stack = depth_features_many(ranges, ComparisonParams())
    everywhere, measured = (
        np.stack([double_gradients(depth_features(image, ComparisonParams(is_measured_only=only))) for image in ranges])
        for only in (False, True)
    )
    found = []
    image = visual_features(gray, seen)
    for visual in (image, image.mirrored):
        curves: list[NDArray[Any]] = [similarity_many(visual, stack, SYNTHESIS.num_columns)]
        curves += [correlation(visual, tensors) for tensors in (everywhere, measured)]
        found.append([figures(curve) for curve in curves])
    return np.swapaxes(np.array(found), 0, 1)


def correlation(visual: GradientFeatures, tensors: NDArray[np.float32]) -> Array:
    """Return the correlation (N, W) of an image with doubled gradients (N, 2, H, W), over their length in view."""
    seen = np.ones(visual.shape, np.float32) if visual.is_seen is None else visual.is_seen.astype(np.float32)
    products = _around(double_gradients(visual) * seen, tensors)
    energies = _around(seen[None], np.sum(tensors**2, axis=1, keepdims=True))
    best: Array = products / np.sqrt(np.maximum(energies, max(MIN_SHARE * float(energies.max()), 1e-12)))
    return best


def figures(curves: Array) -> tuple[float, float, float]:
    """Return how far truth (place in the middle, heading 0) stands out, its heading's error in deg, and what fits more.

    Standard deviations of all other places and headings; the share of them that fit better.
    """
    count = curves.shape[1]
    turns = np.abs((np.arange(count) + count // 2) % count - count // 2) * 360.0 / count
    middle = len(curves) // 2
    true = curves[middle, turns <= NEAR_DEG].max()
    others = np.concatenate([np.delete(curves, middle, axis=0).ravel(), curves[middle, turns > OTHER_DEG]])
    out = (true - others.mean()) / max(float(others.std()), 1e-12)
    return float(out), float(turns[np.argmax(curves[middle])]), float(np.mean(others > true))


def _around(image: NDArray[np.float32], pictures: NDArray[np.float32]) -> Array:
    """Return the sum of products (N, W) of an image (C, H, W) with pictures (N, C, H, W) turned by 0 to W - 1."""
    left, right = scipy.fft.rfft(image), scipy.fft.rfft(pictures).conj()
    sums: Array = scipy.fft.irfft(np.einsum("chf,nchf->nf", left, right), image.shape[-1])
    return sums


def _offsets() -> Array:
    """Return the places (N, 2) around the truth, which is in the middle."""
    steps = np.arange(-REACH, REACH + STEP / 2, STEP)
    return np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)


def _row(name: str, found: Array, by_eq2: Array) -> tuple[str, ...]:
    """Return a row of figures (F, mirrored, figure), and those of eq. 2 (F, figure)."""
    out, off, more = np.moveaxis(found, 2, 0)
    cells = [f"{x:.2f}" for x in np.median(out, axis=0)] + [f"{x:.0%}" for x in np.mean(off <= COMPASS_DEG, axis=0)]
    cells += [f"{x:.2%}" for x in np.median(more, axis=0)]
    against = "" if name == LIKENESSES[0] else f"{_p(found[:, 0], by_eq2):.2g}"
    return name, *cells, f"{_p(found[:, 0], found[:, 1]):.2g}", against


def _p(ours: Array, theirs: Array) -> float:
    """Return Wilcoxon's p, one-sided, that the first figure (F, figure) is not larger than the other's."""
    return float(wilcoxon(ours[:, 0], theirs[:, 0], alternative="greater").pvalue)


def _surround(folder: Path) -> Iterator[Frame]:
    """Yield the cameras of a nuScenes key frame; none without the folder."""
    if not folder.is_dir():
        return
    calibration = json.loads((folder / "calibration.json").read_text(encoding="utf-8"))
    points = sweep(folder, calibration)
    for name, camera in calibration["cameras"].items():
        K = np.array(camera["K"])
        yield _frame(name, folder / camera["file"], K, points, np.array(camera["cam2ego"]))


def _drive(options: argparse.Namespace) -> Iterator[Frame]:
    """Yield frames of a folder as KITTI's: camera 2 in the axes of its LiDAR; none without the folder."""
    folder = options.street
    if folder is None:
        return
    if options.every < 1:
        raise ValueError(f"--every: expected at least 1, found {options.every}")
    sweeps = sorted((folder / "velodyne").glob("*.bin"))[:: options.every]
    if not sweeps:
        raise ValueError(f"--street: {folder / 'velodyne'}: expected sweeps .bin, found none")
    for path in sweeps:
        own = folder / "calib" / f"{path.stem}.txt"
        K, T_lidar_camera = read_calibration(own if own.is_file() else folder / "calib.txt")
        points = np.fromfile(path, np.float32).reshape(-1, 4)[:, :3].astype(np.float64)
        points = points[np.linalg.norm(points[:, :2], axis=1) > CAR]
        yield _frame(path.stem, folder / "image_2" / f"{path.stem}.png", K, points, T_lidar_camera)


def _frame(name: str, path: Path, K: Array, points: Array, T_level_camera: Array) -> Frame:
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise ValueError(f"{path}: expected an image, found none")
    camera = Pinhole(image.shape[1], image.shape[0], K[0, 0], K[1, 1], K[0, 2], K[1, 2])
    return Frame(name, image, camera, points, T_level_camera)


def read_calibration(path: Path) -> tuple[Array, Array]:
    """Return K (3, 3) and T_lidar_camera (4, 4) of camera 2 from a file of KITTI: P2, R0_rect, Tr or Tr_velo_to_cam."""
    found = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        name, _, values = line.partition(":")
        found[name.strip()] = values.split()
    lidar = "Tr_velo_to_cam" if "Tr_velo_to_cam" in found else "Tr"
    if missing := [name for name in ("P2", lidar) if len(found.get(name, ())) != 12]:
        raise ValueError(f"{path}: {missing[0]}: expected 12 numbers, found {len(found.get(missing[0], ()))}")
    P = np.array(found["P2"], np.float64).reshape(3, 4)
    T_camera0_lidar, R_rectified, T_camera_rectified = np.eye(4), np.eye(4), np.eye(4)
    T_camera0_lidar[:3] = np.array(found[lidar], np.float64).reshape(3, 4)
    if "R0_rect" in found:
        R_rectified[:3, :3] = np.array(found["R0_rect"], np.float64).reshape(3, 3)
    T_camera_rectified[:3, 3] = np.linalg.solve(P[:, :3], P[:, 3])
    T_lidar_camera = np.linalg.inv(T_camera_rectified @ R_rectified @ T_camera0_lidar).astype(np.float64)
    return P[:, :3], T_lidar_camera
