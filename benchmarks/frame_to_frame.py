"""Frame-to-frame registration of recorded RGB-D pairs, ours beside OpenCV's and Open3D's odometry, in one run.

A 7-Scenes recording is judged by COLMAP's poses where they lie beside it, in both halves: its recorded ones measure
KinectFusion. All methods get the same images, taken as from a global shutter, and none is told of a motion.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from benchmarks.machine import describe, milliseconds
from benchmarks.peers import Method, peers
from benchmarks.report import Bound, Report, Table
from benchmarks.rgbd_data import Calibration, Frame, Recording, colmap_poses, open_recording

HELP = "RGB-D frame to frame against OpenCV and Open3D (DESIGN 7)"
DEFAULT_DATA = Path("../shared/data/rgbd/redkitchen")
FAILURE_MM = 50.0
OURS = "sphere_nav"
NUM_WARM_UP = 2
SETTLE = 0.5  # s for the threads of the method before to fall asleep
SIZES = ("median mm", "mean mm", "p90 mm", "median °", "mean °", "> 50 mm", "tracking ms", "new reference ms")
COLUMNS = ("calibration", "k", "method", *SIZES)
HALVES = ("first half", "second half")
NOT_PEERS = (OURS, "no motion")


@dataclass
class Figures:
    """What one method did on all pairs that are k frames apart."""

    errors_mm: list[float] = field(default_factory=list)
    errors_deg: list[float] = field(default_factory=list)
    prepare_ms: list[float] = field(default_factory=list)
    track_ms: list[float] = field(default_factory=list)

    @property
    def num_failures(self) -> int:
        """Pairs with more than 50 mm error, refused ones included."""
        return int(np.sum(np.array(self.errors_mm) > FAILURE_MM))

    @property
    def tracking_ms(self) -> float:
        """Median time of a new frame against a reference prepared before."""
        return float(np.median(self.track_ms))

    @property
    def new_reference_ms(self) -> float:
        """Median time of a pair, the preparation of its reference included."""
        return float(np.median(np.add(self.prepare_ms, self.track_ms)))

    @property
    def median_mm(self) -> float:
        """Median error of the translation."""
        return float(np.median(self.errors_mm))

    def halves(self) -> tuple[Figures, Figures]:
        """Return the figures of the earlier and of the later pairs."""
        middle = len(self.errors_mm) // 2
        columns = (self.errors_mm, self.errors_deg, self.prepare_ms, self.track_ms)
        return Figures(*(one[:middle] for one in columns)), Figures(*(one[middle:] for one in columns))

    def cells(self) -> tuple[str, ...]:
        """Return the right half of a row."""
        return (
            f"{self.median_mm:.2f}",
            f"{np.mean(self.errors_mm):.2f}",
            f"{np.percentile(self.errors_mm, 90, method='higher'):.2f}",
            f"{np.median(self.errors_deg):.3f}",
            f"{np.mean(self.errors_deg):.3f}",
            f"{self.num_failures} of {len(self.errors_mm)}",
            f"{self.tracking_ms:.1f}",
            f"{self.new_reference_ms:.1f}",
        )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of this benchmark."""
    parser.add_argument("--data", type=Path, default=DEFAULT_DATA, help="7-Scenes folder, or folder of TUM pairs")
    parser.add_argument("--poses", type=Path, metavar="DIR", help="of the colour camera (DATA_colmap_poses, if there)")
    parser.add_argument("--recorded-poses", action="store_true", help="judge by the poses beside the images")
    parser.add_argument("--gaps", type=int, nargs="+", default=[1, 5, 10], metavar="K", help="frames apart (1 5 10)")
    parser.add_argument("--step", type=int, default=5, help="frames between the starts of pairs (5)")
    parser.add_argument("--calibration", default="both", help="one by name, or both")
    parser.add_argument("--max-depth", type=float, default=8.0, metavar="M", help="depth beyond is cut for all (8 m)")
    parser.add_argument("--only-ours", action="store_true", help="leave the peers out")


def run(options: argparse.Namespace) -> Report:
    """Measure every method on the same images, depth, intrinsics and threads."""
    if not options.data.is_dir():
        return Report("frame_to_frame", skipped=f"no folder {options.data}; --data names a recording")
    poses = None if options.recorded_poses else options.poses or colmap_poses(options.data)
    recording = open_recording(options.data, poses)
    report = Report("frame_to_frame", notes=[describe(options.threads), _describe(options, poses)])
    gaps = [k for k in options.gaps if not recording.gaps or k in recording.gaps] or list(recording.gaps)
    step = options.step * (4 if options.quick else 1)
    rows: list[tuple[str, ...]] = []
    for calibration in _chosen(recording, options.calibration):
        methods, notes = _methods(calibration, options, report)
        report.notes += [note for note in notes if note not in report.notes]
        for gap in gaps:
            figures = _measure(methods, recording, calibration, gap, step, options.max_depth)
            rows += [(calibration.name, str(gap), name, *found.cells()) for name, found in figures.items()]
            report.bounds += _bounds(figures, calibration.name, gap)
    report.tables.append(Table(f"Pairs k frames apart of {options.data.name}", COLUMNS, rows))
    return report


def _describe(options: argparse.Namespace, poses: Path | None) -> str:
    return (
        f"{options.data}: all methods get the same grey images, the same depth (up to {options.max_depth:g} m) and "
        "intrinsics, and start from no motion. Errors are those of T_reference_current against "
        f"{poses.name if poses else 'the recorded poses'}. "
        "'tracking' finds a new frame from a reference prepared before; 'new reference' prepares it too."
    )


def _chosen(recording: Recording, name: str) -> list[Calibration]:
    chosen = [c for c in recording.calibrations if name in ("both", c.name)]
    if not chosen:
        names = ", ".join(c.name for c in recording.calibrations)
        raise ValueError(f"--calibration: expected both or one of {names}, found {name}")
    return chosen


def _methods(calibration: Calibration, options: argparse.Namespace, report: Report) -> tuple[list[Method], list[str]]:
    methods, notes = ([], []) if options.only_ours else peers(calibration.camera, options.max_depth)
    try:
        from benchmarks.ours import Ours
    except ImportError as error:
        return methods, [*notes, f"our registration cannot be imported: {error}"]
    return [*methods, Ours(calibration.camera)], notes


def _measure(
    methods: list[Method], recording: Recording, calibration: Calibration, gap: int, step: int, max_depth_m: float
) -> dict[str, Figures]:
    figures = {method.name: Figures() for method in methods}
    pairs = recording.pairs(gap, step)
    if not pairs:
        raise ValueError(f"{recording.folder}: expected more than {gap} frames for pairs {gap} apart, found fewer")
    frames = {path: _cut(recording.frame(path, calibration), max_depth_m) for path in dict.fromkeys(sum(pairs, ()))}
    # one method after the other, as each would run on a vehicle: threads of one that still spin stall the next
    for method in methods:
        _warm_up(method, frames[pairs[0][0]])
        for reference, current in tqdm(pairs, f"{calibration.name}, {gap} apart", leave=False, disable=None):
            _measure_pair(method, frames[reference], frames[current], figures[method.name])
    return figures


def _cut(frame: Frame, max_depth_m: float) -> Frame:
    return replace(frame, depth_m=np.where(frame.depth_m <= max_depth_m, frame.depth_m, np.float32(np.nan)))


def _warm_up(method: Method, frame: Frame) -> None:
    time.sleep(SETTLE)
    for _ in range(NUM_WARM_UP):
        method.track(method.prepare(frame), frame)


def _measure_pair(method: Method, reference: Frame, current: Frame, figures: Figures) -> None:
    prepare_ms, prepared = milliseconds(lambda: method.prepare(reference))
    track_ms, T_reference_current = milliseconds(lambda: method.track(prepared, current))
    figures.prepare_ms.append(prepare_ms)
    figures.track_ms.append(track_ms)
    T_true = reference.T_world_camera.inverse() @ current.T_world_camera
    meters, radians = T_true.distance(T_reference_current) if T_reference_current else (math.inf, math.inf)
    figures.errors_mm.append(1e3 * float(meters))
    figures.errors_deg.append(math.degrees(radians))


def _bounds(figures: dict[str, Figures], calibration: str, gap: int) -> list[Bound]:
    if OURS not in figures:
        return []
    ours, where = figures[OURS], f"{calibration}, k = {gap}"
    bounds = [Bound(f"failures, {where}", 0, ours.num_failures, "pairs")]
    others = {name: found for name, found in figures.items() if name not in NOT_PEERS}
    if others:
        tracking = min(found.tracking_ms for found in others.values())
        whole = min(found.new_reference_ms for found in others.values())
        bounds += [
            Bound(f"tracking, fastest peer by ours, {where}", 10.0, tracking / ours.tracking_ms, "x", is_minimum=True),
            Bound(
                f"new reference, fastest peer by ours, {where}",
                1.0,
                whole / ours.new_reference_ms,
                "x",
                is_minimum=True,
            ),
        ]
    return bounds + _against_best(figures, where)


def _against_best(figures: dict[str, Figures], where: str) -> list[Bound]:
    """Return our median beside the least of the peers': of all pairs, and of each half."""
    halves = {name: found.halves() for name, found in figures.items()}
    parts = [("", figures), *((f", {half}", {name: both[i] for name, both in halves.items()})
                              for i, half in enumerate(HALVES))]  # fmt: skip
    bounds = []
    for part, found in parts:
        medians = {name: one.median_mm for name, one in found.items() if name not in NOT_PEERS and one.errors_mm}
        if medians:
            best = min(medians, key=medians.__getitem__)
            what = f"median error against the best peer, {best}, {where}{part}"
            bounds.append(Bound(what, medians[best], found[OURS].median_mm, "mm"))
    return bounds
