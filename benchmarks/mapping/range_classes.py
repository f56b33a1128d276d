"""Range by class of surface: what is measured, what of it is wrong, in towns, and what it costs."""

from __future__ import annotations

import argparse
import time
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Bound, Headline, Report, Table
from benchmarks.rig import images_of, rig_in_world
from cycab_sim.sensors.cameras import rig_place
from sphere_mapping.acquisition.params import StitchParams
from sphere_mapping.acquisition.stitching.stitcher import Stitcher
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.params import build

CLASSES = ("textured", "bare", "unlit", "edge", "thin", "ground", "far")
NEAR_M, FAR_M = 30.0, 120.0  # up to which range is judged; from which on a surface is far
EDGE_PX, THIN_PX = 5, 9  # of 2048 columns: from a jump; things less wide are thin
JUMP = (0.05, 1e-3)  # of inverse range between neighbors, beside its slope: by itself, in 1/m
BARE_LEVELS, UNLIT_LEVEL, DETAIL_PX = 2.0, 8.0, 9  # deviation of grey levels, their mean, over so many px
GROUND_M = 0.03  # heights within which a point is of the ground
Plane = NDArray[np.float32]


def run(options: argparse.Namespace) -> Report:
    """Measure a town, or three, by each rig; and time."""
    report = Report("range_classes")
    width, num_towns = (1024, 1) if options.size == "quick" else (2048, 3)
    seeds = range(options.seed, options.seed + num_towns)
    told = Headline("map", "towns of the simulator")
    for kind in ("ring", "vertical"):
        total, cpu_s = np.zeros((len(CLASSES), 5)), list[float]()
        for seed in seeds:
            found, seconds = _measure(kind, seed, width)
            total += found
            cpu_s += seconds
        there, n, beyond_3_sigma, beyond_10_percent, right = total.T
        shares = np.stack([there / there.sum(), n / there, right / there, beyond_3_sigma / n, beyond_10_percent / n])
        rows = [(name, *(f"{100 * share:.2f}" for share in shares[:, k])) for k, name in enumerate(CLASSES)]
        columns = ("surface", "of all %", "measured %", "right %", "of measured beyond 3 sigma %", "beyond 10 % %")
        report.tables.append(Table(f"Seen by a {kind} rig, {width} px", columns, rows))
        wrong, worst = float(beyond_3_sigma.sum() / n.sum()), float(np.nanmax(shares[4, :-1]))
        least = 0.75 if kind == "ring" else 0.8
        report.bounds += [
            Bound(f"{kind}, all classes: measured, beyond 3 sigma", 0.02, wrong, "", False, told),
            Bound(f"{kind}, worst class: measured, beyond 10 %", 0.03, worst, "", False, told),
            Bound(f"{kind}, textured: measured right", least, float(shares[2, 0]), "", True, told),
            Bound(f"{kind}, far: nearer than it is", 0.005, float(beyond_3_sigma[-1] / there[-1]), ""),
            Bound(f"{kind}, {width} px: range of an instant, CPU", 0.45, float(np.median(cpu_s)), "s"),
        ]
    return report


def _measure(kind: str, seed: int, width: int) -> tuple[NDArray[np.float64], list[float]]:
    """Return counts (classes, 5): there, measured, off by 3 sigma, off by 10 %, right; and CPU times of the range.

    What is told to be far is wrong where something near is there, and the other way round.
    """
    simulator, rig = rig_in_world(seed, width, {"rig.kind": kind})
    stitcher = Stitcher(rig, build(StitchParams, {"width": width}))
    images, _ = stitcher.equalize(images_of(simulator))
    grays = {name: cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for name, image in images.items()}
    assert stitcher.stereo is not None
    seconds = []
    for _ in range(2):
        begun = time.process_time()
        [(range_m, std_m)] = stitcher.stereo.find(grays)
        seconds.append(time.process_time() - begun)
    T_world_sphere = simulator.T_world_base @ rig_place(simulator.params.rig) @ stitcher.T_rig_sphere
    levels, truth = simulator.render(stitcher.whole, T_world_sphere)
    classes = classify(levels, truth, stitcher.whole, T_world_sphere)
    known, is_far = ~np.isnan(range_m), classes == len(CLASSES) - 1
    with np.errstate(invalid="ignore"):
        error = np.abs(range_m - truth)
        is_off = np.isinf(range_m) | (error > 3 * std_m)
        is_wide = ~(error <= 0.1 * truth)
        is_near = known & (range_m + 3 * std_m < FAR_M)
    is_off, is_wide = np.where(is_far, is_near, is_off), np.where(is_far, is_near, is_wide)
    counts = []
    for number in range(len(CLASSES)):
        keep = (classes == number) & (is_far | (truth < NEAR_M))
        parts = (keep, keep & known, keep & known & is_off, keep & known & is_wide, keep & known & ~is_wide)
        counts.append([np.count_nonzero(part) for part in parts])
    return np.array(counts, np.float64), seconds[1:]


def classify(levels: NDArray[Any], truth: Plane, whole: Spherical, T_world_sphere: SE3) -> NDArray[np.int8]:
    """Return the class (H, W) of what a sphere truly shows (H, W, 3) at its true range; the last ones take precedence.

    What has no detail is bare, whatever it is made of; what is dark is unlit.
    """
    gray = cv2.cvtColor(levels, cv2.COLOR_RGB2GRAY).astype(np.float32)
    mean = _around(gray, lambda plane: cv2.blur(plane, (DETAIL_PX, DETAIL_PX)))
    square = _around(gray * gray, lambda plane: cv2.blur(plane, (DETAIL_PX, DETAIL_PX)))
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = np.where(np.isfinite(truth), 1 / np.maximum(truth, 0.05), 0).astype(np.float32)
        height = pixel_rays(whole) @ T_world_sphere.rotation[2] * truth + T_world_sphere.translation[2]
    found = np.zeros(truth.shape, np.int8)
    jump = np.zeros(truth.shape, np.bool_)
    for axis in range(2):
        bend = np.abs(np.roll(inverse, 1, axis) + np.roll(inverse, -1, axis) - 2 * inverse)
        jump |= bend > JUMP[0] * inverse + JUMP[1]
    scale = whole.width / 2048
    edge, thin = (np.ones((2 * round(px * scale) + 1,) * 2, np.uint8) for px in (EDGE_PX, 0.5 * (THIN_PX - 1)))
    opened = _around(inverse, lambda plane: cv2.morphologyEx(plane, cv2.MORPH_OPEN, thin))
    is_thin = (inverse > 1.1 * opened + 2 * JUMP[1]).astype(np.uint8)
    found[np.abs(height) < GROUND_M] = CLASSES.index("ground")
    found[np.maximum(square - mean * mean, 0) < BARE_LEVELS**2] = CLASSES.index("bare")
    found[mean < UNLIT_LEVEL] = CLASSES.index("unlit")
    found[_around(jump.astype(np.uint8), lambda plane: cv2.dilate(plane, edge)) > 0] = CLASSES.index("edge")
    found[_around(is_thin, lambda plane: cv2.dilate(plane, np.ones((3, 3), np.uint8))) > 0] = CLASSES.index("thin")
    found[~(truth <= FAR_M)] = CLASSES.index("far")
    return found


def _around(plane, work):  # type: ignore[no-untyped-def]
    """Return what work makes of a plane (H, W) whose columns wrap around."""
    return work(cv2.copyMakeBorder(plane, 0, 0, 16, 16, cv2.BORDER_WRAP))[:, 16:-16]
