"""Range by class of surface: what is measured, what of it is wrong, in towns and rooms, and what it costs."""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.kernel_times import YARDSTICK, yardstick
from benchmarks.machine import describe, repeat_cpu
from benchmarks.range_honesty import Honesty, honesty
from benchmarks.range_worlds import BARE, REPETITIVE, UNLIT, make_scene
from benchmarks.report import Bound, Report, Table
from cycab_sim.params import SimParams
from cycab_sim.sensors.rigs import rig_place
from cycab_sim.simulator import Simulator
from sphere_mapping.acquisition.params import StitchParams
from sphere_mapping.acquisition.stitching.stitcher import Stitcher
from sphere_nav.geometry import SE3, Rig, Spherical
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.params import build

HELP = "range by class of surface (textured, bare, unlit, edge, thin, ground, far): measured, wrong; its CPU time"
CLASSES = ("textured", "bare", "unlit", "repetitive", "edge", "thin", "ground", "far")
BOUNDED = ("textured", "bare", "unlit", "edge", "thin", "ground")
NEAR_M, FAR_M = 30.0, 120.0  # up to which range is judged; from which on a surface is far
EDGE_PX, THIN_PX = 5, 9  # of 2048 columns: from a jump; things less wide are thin
JUMP = (0.05, 1e-3)  # of inverse range between neighbors, beside its slope: by itself, in 1/m
BARE_LEVELS, UNLIT_LEVEL, DETAIL_PX = 2.0, 8.0, 9  # deviation of grey levels, their mean, over so many px
GROUND_M = 0.03  # heights within which a point is of the ground
NOTHING = Honesty(0, 0, 0, 0, 0, 0.0, 0)
Image = NDArray[np.uint8]
Plane = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Seen:
    """Images of a rig at one instant; true range (H, W) m, grey levels and classes of the sphere."""

    rig: Rig
    images: dict[str, Image]
    truth: Plane
    classes: NDArray[np.int8]


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Say which worlds are seen, and how."""
    parser.add_argument("--class-towns", type=int, nargs="*", default=[71, 72, 73], help="seeds (%(default)s)")
    parser.add_argument("--class-rooms", type=int, nargs="*", default=[19, 20, 21], help="seeds (%(default)s)")
    parser.add_argument("--class-rigs", nargs="+", default=["ring", "vertical"], help="rigs (%(default)s)")
    parser.add_argument("--class-width", type=int, default=2048, help="columns of the sphere (%(default)s)")
    parser.add_argument("--class-view", type=float, default=190.0, help="field of view of a camera, deg (%(default)s)")


def run(options: argparse.Namespace) -> Report:
    """Measure worlds by each rig, noise, and time."""
    bounds, tables = [], []
    for kind in options.class_rigs:
        total, shared, cpu_s = [NOTHING] * len(CLASSES), [NOTHING] * len(CLASSES), []
        towns, rooms = (seeds[:1] if options.quick else seeds for seeds in (options.class_towns, options.class_rooms))
        for number, seed in enumerate([*towns, *rooms]):
            seen = (_town if number < len(towns) else _room)(kind, seed, options)
            stitcher = Stitcher(seen.rig, build(StitchParams, {"width": options.class_width}))
            found, around, seconds = _measure(stitcher, seen)
            total, shared = ([a + b for a, b in zip(*pair, strict=True)] for pair in ((total, found), (shared, around)))
            cpu_s += seconds
        tables.append(_table(kind, total, shared))
        bounds += [*_bounds(kind, total), *_noise(kind, stitcher, seen)]
        bounds.append(Bound(f"{kind}: range of an instant, CPU, median of {len(cpu_s)}", 0.45, _median(cpu_s), "s"))
    yardstick_ms = float(np.median(repeat_cpu(yardstick(), 100)))
    notes = [describe(options.threads), f"{YARDSTICK}: {yardstick_ms:.3g} ms"]
    notes.append(f"judged within {NEAR_M:g} m; edges reach {EDGE_PX} px, thin things are up to {THIN_PX} px wide")
    return Report("range_classes", tables, bounds, notes)


def _measure(stitcher: Stitcher, seen: Seen) -> tuple[list[Honesty], list[Honesty], list[float]]:
    """Return the counts by class, those by the truth of the nearest pixels, and CPU times of the range alone."""
    grays = {name: cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for name, image in stitcher.equalize(seen.images)[0].items()}
    assert stitcher.stereo is not None
    seconds = []
    for _ in range(3):
        begun = time.process_time()
        [(range_m, std_m)] = stitcher.stereo.find(grays).measured
        seconds.append(time.process_time() - begun)
    is_near = np.isfinite(seen.truth) & (seen.truth < NEAR_M)
    surfaces = [is_near & (seen.classes == k) for k in range(len(CLASSES) - 1)]
    counts = [honesty(range_m, std_m, seen.truth, surface) for surface in surfaces]
    around = likeliest_around(range_m, seen.truth)
    shared = [honesty(range_m, std_m, around, surface) for surface in surfaces]
    is_far = (seen.classes == len(CLASSES) - 1) & ~np.isnan(range_m)
    near = np.nan_to_num(np.where(is_far, range_m + 3 * std_m, np.inf), nan=np.inf, posinf=np.inf)
    wrong = int((near < FAR_M).sum())
    num_far = int((seen.classes == len(CLASSES) - 1).sum())
    right = int(is_far.sum()) - wrong
    far = Honesty(num_far, int(is_far.sum()), wrong, wrong, right, 0.0, 0)
    return [*counts, far], [*shared, far], seconds[1:]


def likeliest_around(range_m: Plane, truth: Plane) -> Plane:
    """Return, of the true ranges (H, W) of a pixel and its eight neighbors, the one nearest to what is measured.

    At an edge two surfaces share a pixel, of which its middle tells one.
    """
    padded = np.pad(np.pad(truth, ((0, 0), (1, 1)), mode="wrap"), ((1, 1), (0, 0)), mode="edge")
    height, width = truth.shape
    found, least = truth.copy(), np.full(truth.shape, np.inf, np.float32)
    for row, column in np.ndindex(3, 3):
        other = padded[row : row + height, column : column + width]
        with np.errstate(invalid="ignore"):
            off = np.abs(range_m - other)
        is_nearer = off < least  # never where one of both is infinite or unknown
        found[is_nearer], least[is_nearer] = other[is_nearer], off[is_nearer]
    return found


def _town(kind: str, seed: int, options: argparse.Namespace) -> Seen:
    values = {"rig.kind": kind, "seed": seed, "rig.view_deg": options.class_view}
    side = options.class_width * 17 // 32
    simulator = Simulator(build(SimParams, values | {"rig.size": f"{side},{side}"}))
    assert simulator.rig is not None
    images = {name: frame.image for name, frame in simulator.capture_rig().items()}
    stitcher = Stitcher(simulator.rig, build(StitchParams, {"width": options.class_width, "range": "none"}))
    T_base_sphere = rig_place(simulator.params.rig) @ stitcher.T_rig_sphere
    T_world_sphere = simulator.vehicle.state.T_world_base @ T_base_sphere
    levels, truth = simulator.render(stitcher.whole, T_world_sphere)
    classes = classify(levels, truth, stitcher.whole, T_world_sphere)
    return Seen(simulator.rig, images, truth, classes)


def _room(kind: str, seed: int, options: argparse.Namespace) -> Seen:
    scene = make_scene(seed, kind, options.class_width, {"view_deg": options.class_view})
    stitcher = Stitcher(scene.rig, build(StitchParams, {"width": options.class_width, "range": "none"}))
    truth, panels = scene.truth(stitcher.whole, stitcher.T_rig_sphere)
    T_world_sphere = scene.T_world_rig @ stitcher.T_rig_sphere
    levels, _ = scene.renderer.render(stitcher.whole, T_world_sphere)
    classes = classify(levels, truth, stitcher.whole, T_world_sphere)
    is_surface = classes < CLASSES.index("edge")
    for panel, name in ((BARE, "bare"), (UNLIT, "unlit"), (REPETITIVE, "repetitive")):
        classes[is_surface & (panels == panel)] = CLASSES.index(name)
    return Seen(scene.rig, scene.images, truth, classes)


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


def _noise(kind: str, stitcher: Stitcher, seen: Seen) -> list[Bound]:
    """Return the share of directions that have a range in images of nothing but noise."""
    rng, bounds = np.random.default_rng(0), []
    assert stitcher.stereo is not None
    for blur in (0.0, 1.5):
        noise = {}
        for name, image in seen.images.items():
            plane = rng.normal(0, 1, image.shape[:2]).astype(np.float32)
            plane = cv2.GaussianBlur(plane, (0, 0), blur) if blur else plane
            noise[name] = np.clip(128 + 30 * plane / plane.std(), 0, 255).astype(np.uint8)
        measured = float(1 - np.isnan(stitcher.stereo.find(noise).measured[0][0]).mean())
        bounds.append(Bound(f"{kind}: noise, blurred by {blur} px: measured", 0.01, measured, ""))
    return bounds


def _bounds(kind: str, total: list[Honesty]) -> list[Bound]:
    bounds = []
    for name in BOUNDED:
        one = total[CLASSES.index(name)]
        bounds += [
            Bound(f"{kind}, {name}: measured, beyond 3 sigma", 0.02, one.beyond_3_sigma / max(one.n, 1), ""),
            Bound(f"{kind}, {name}: measured, beyond 10 %", 0.03, one.beyond_10_percent / max(one.n, 1), ""),
        ]
    textured, far = total[0], total[-1]
    least = 0.75 if kind == "ring" else 0.80
    right = textured.within_10_percent / max(textured.there, 1)
    bounds.append(Bound(f"{kind}, textured: measured right", least, right, "", is_minimum=True))
    bounds.append(Bound(f"{kind}, far: nearer than it is", 0.005, far.beyond_3_sigma / max(far.there, 1), ""))
    return bounds


def _table(kind: str, total: list[Honesty], shared: list[Honesty]) -> Table:
    number, rows = sum(one.there for one in total), []
    for name, one, around in zip(CLASSES, total, shared, strict=True):
        shares = (one.there / number, one.n / max(one.there, 1), one.within_10_percent / max(one.there, 1))
        wrong = [part / max(one.n, 1) for part in (one.beyond_3_sigma, one.beyond_10_percent, around.beyond_3_sigma)]
        rows.append((name, *(f"{100 * share:.2f}" for share in (*shares, *wrong))))
    columns = ("surface", "of all %", "measured %", "right %", "of measured beyond 3 sigma %", "beyond 10 % %")
    last = "beyond 3 sigma of all within a pixel %"
    return Table(f"Seen by a {kind} rig", (*columns, last), rows)


def _median(values: list[float]) -> float:
    return float(np.median(values))
