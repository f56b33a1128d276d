"""`refine-camera` on real and rendered drives: the true lens within 3 deviations or refused, never worse elsewhere.

Rendered drives are in the world of one key sphere of a real map (`lens_worlds.py`), or of the closed-form room where
there is no recording or `--lens-world room` asks for it; `--lens-seed N` draws other ways, rooms and lenses, on which
nothing was chosen. What was refined by one stretch of a drive is judged by the poses of another stretch.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml

from benchmarks.end_to_end import READOUT_S, TRUTH, call
from benchmarks.lens_worlds import Recorded, SphereWorld, Sway, record, room_sphere
from benchmarks.machine import describe
from benchmarks.report import Bound, Report
from benchmarks.rgbd_data import colmap_poses
from benchmarks.straight_truth import bend
from rig_calibration.drive.drive_lens import Lens
from sphere_nav.geometry import Camera, Pinhole, Spherical
from sphere_nav.geometry.trajectory import read_tum
from sphere_nav.ros.bags import BagReader
from sphere_nav.ros.bags.writer import BagWriter
from sphere_nav.ros.conversions import camera_from_info, camera_to_info, stamp_ns
from sphere_nav.ros.maps.reader import open_map
from sphere_nav_tools.cli.main import main as sphere_nav
from sphere_nav_tools.offline.evaluation import evaluate_poses
from sphere_nav_tools.offline.mapping.drive import fit_poses
from sphere_nav_tools.offline.pose_bags import read_poses

HELP = "lenses refined by a drive: the truth within 3 deviations or refused, readouts that help"
MAX_SIGMAS, MAX_WORSE = 3.0, 1.05
KITCHEN = Pinhole(640, 480, 526.5, 527.3, 319.2, 237.2, (0.006, -0.062, 0.0, 0.0))  # fitted with COLMAP's poses
ROW_NS = 1_000  # between a stamp of a bag and the same in another one
SMALL = Pinhole(256, 192, 210.0, 210.0, 127.5, 95.5)
LONG = replace(SMALL, fx=218.4, fy=218.4)  # 4 % off
WIDE = Pinhole(256, 192, 180.0, 181.0, 130.0, 93.0, (-0.08, 0.01, 0.0, 0.0))
GUESS = Pinhole(256, 192, 186.0, 186.0, 127.5, 95.5)  # 3 % off, no distortion
REAL = (  # name, mapped, refined by, judged by, camera_info
    ("kitchen 120:200 in 0:120", "0:120", "120:200", "200:240", "525,525,320,240"),
    ("kitchen 40:120 in 120:240", "120:240", "40:120", "0:40", "525,525,320,240"),
    ("kitchen odd in even", "0:160:2", "1:160:2", "161:240:2", "525,525,320,240"),
    ("kitchen 120:200 in 0:120, 5 % off", "0:120", "120:200", "200:240", "551,551,320,240"),
)


@dataclass(frozen=True)
class Case:
    """A map, the drive that refines, one that judges, and the true lens; the readout the drive is to find."""

    name: str
    map: Path
    drive: Path
    held_out: Path
    truth: Lens


@dataclass(frozen=True)
class Drawn:
    """A rendered sequence: the camera that maps and what its camera_info says, the camera that drives, and its."""

    name: str
    mapping: Recorded
    driving: Recorded
    seed: int


DRAWN = (
    Drawn("right lens", Recorded(SMALL, SMALL), Recorded(SMALL, SMALL), 11),
    Drawn("4 % too long", Recorded(SMALL, SMALL), Recorded(SMALL, LONG), 12),
    Drawn("another lens, guessed", Recorded(SMALL, SMALL), Recorded(WIDE, GUESS), 13),
    Drawn("rolling shutter", Recorded(SMALL, SMALL), Recorded(SMALL, SMALL, READOUT_S), 14),
    Drawn("map of a wrong lens", Recorded(SMALL, LONG), Recorded(SMALL, SMALL), 15),
    Drawn("map and drive of the same wrong lens", Recorded(SMALL, LONG), Recorded(SMALL, LONG), 16),
)
QUICK = ("4 % too long", "map of a wrong lens")
OTHER_LENS = np.array([0.06, 0.06, 0.03, 0.03])  # shares by which focal lengths and center of another seed may differ
KITCHEN_WORLD, ROOM_WORLD = WORLDS = "kitchen", "room"
ROOM_SEED, SEEDS_APART = 3, 1000  # of the room; between the ways of two `--lens-seed`


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments: those of end_to_end say where recordings are."""
    parser.add_argument("--sequences", nargs="*", metavar="WORD", help="only sequences whose names hold one of these")
    parser.add_argument("--lens-seed", type=int, default=0, metavar="N", help="of rendered ways, rooms, lenses (0)")
    parser.add_argument("--lens-world", choices=WORLDS, default=KITCHEN_WORLD, help="of rendered drives (%(default)s)")


def run(options: argparse.Namespace) -> Report:
    """Refine, judge, and drive with a readout."""
    report = Report("lens_drive", notes=[describe(options.threads)])
    data = options.recordings / "rgbd/redkitchen"
    wanted: Sequence[str] = options.sequences or (QUICK if options.quick else [""])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        seed = options.lens_seed
        world = make_world(data if options.lens_world == KITCHEN_WORLD else None, folder, seed)
        cases = [*drawn_cases(world, folder, wanted, seed), *real_cases(data, options.recordings, folder, wanted)]
        for case in cases:
            report.bounds += judge(case, report)
        if any(word in "readout" for word in wanted):
            report.bounds += readout_bounds(world, folder, report, SEEDS_APART * seed)
    return report


def make_world(data: Path | None, folder: Path, seed: int) -> SphereWorld:
    """Return the world of the first key sphere of a real map, or the room of a seed."""
    if data is None or not data.is_dir():
        return SphereWorld(room_sphere(Spherical(512, 384, 1536, 512, 192), ROOM_SEED + seed))
    call("import", "seven_scenes", data, "-o", folder / "seed", "--frames", "0:2")
    call("map", folder / "seed", "-o", folder / "seed_map")
    with open_map(folder / "seed_map") as sphere_map:
        return SphereWorld(sphere_map.load_sphere(0))


def drawn_cases(world: SphereWorld, folder: Path, wanted: Sequence[str], seed: int) -> Iterator[Case]:
    """Yield the rendered sequences: mapped for 1.3 s, refined by 2 s, judged by another second."""
    for number, drawn in enumerate(DRAWN):
        if not any(word in drawn.name for word in wanted):
            continue
        one = redraw(drawn, np.random.default_rng([seed, number])) if seed else drawn
        first, part = one.seed + SEEDS_APART * seed, folder / one.name.replace(" ", "_")
        record(part / "taught", world, one.mapping, Sway(first), 0.0, 40)
        record(part / "drive", world, one.driving, Sway(first + 100), 0.0, 50)
        record(part / "held_out", world, one.driving, Sway(first + 200), 0.0, 30)
        call("map", part / "taught", "-o", part / "map", "--anchor", "truth")
        truth = Lens.of(one.driving.camera, one.driving.readout)
        yield Case(one.name, part / "map", part / "drive", part / "held_out", truth)


def redraw(drawn: Drawn, rng: np.random.Generator) -> Drawn:
    """Return a sequence of other lenses: all focal lengths and centers of it differ by the same shares."""
    shares = 1.0 + OTHER_LENS * rng.uniform(-1.0, 1.0, 4)

    def change(lens: Camera) -> Pinhole:
        assert isinstance(lens, Pinhole)
        fx, fy, cx, cy = (shares * [lens.fx, lens.fy, lens.cx, lens.cy]).tolist()
        return replace(lens, fx=fx, fy=fy, cx=cx, cy=cy)

    def record_by(how: Recorded) -> Recorded:
        return replace(how, camera=change(how.camera), given=change(how.given))

    return replace(drawn, mapping=record_by(drawn.mapping), driving=record_by(drawn.driving))


def real_cases(data: Path, recordings: Path, folder: Path, wanted: Sequence[str]) -> Iterator[Case]:
    """Yield the recorded sequences that are there."""
    for number, (name, mapped, driven, held_out, lens) in enumerate(REAL):
        poses = colmap_poses(data) if data.is_dir() else None
        if poses is None or not any(word in name for word in wanted):
            continue
        part, truth_of = folder / f"real_{number}", ("--poses", poses, "--truth-camera", "colour")
        for bag, frames in (("taught", mapped), ("drive", driven), ("held_out", held_out)):
            given = () if bag == "taught" else ("--camera", lens)
            call("import", "seven_scenes", data, "-o", part / bag, "--frames", frames, *truth_of, *given)
        call("map", part / "taught", "-o", part / "map", "--anchor", "truth")
        yield Case(name, part / "map", part / "drive", part / "held_out", Lens.of(KITCHEN, READOUT_S))
    road, name = recordings / "driving/kitti_06", "kitti_06, odd in even"
    if road.is_dir() and any(word in name for word in wanted):
        part = folder / "road"
        for bag, frames in (("taught", "0:51:2"), ("drive", "1:37:2"), ("held_out", "37:51:2")):
            call("import", "kitti", road, "-o", part / bag, "--frames", frames)
        call("map", part / "taught", "-o", part / "map", "--anchor", "truth")
        with BagReader(part / "drive") as bag_reader:
            printed = camera_from_info(next(bag_reader.messages(["/left/camera_info"])).message)
        yield Case(name, part / "map", part / "drive", part / "held_out", Lens.of(printed))


def judge(case: Case, report: Report) -> Iterator[Bound]:
    """Refine by one stretch; yield how far the lens is off, and what it does to the poses of the other stretch."""
    output, said = case.drive.with_name("camera.yaml"), io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(io.StringIO()):
        words = ["refine-camera", case.map, case.drive, "-o", output, "--images", "24"]
        status = sphere_nav([str(word) for word in words])
    lines = said.getvalue().strip().splitlines()
    print("\n".join([case.name, *lines]), flush=True)
    if status == 0 and output.exists():
        found = yaml.safe_load(output.read_text())
        fx, _, cx, _, fy, cy, *_ = found["camera_matrix"]["data"]
        values = np.array([fx, fy, cx, cy, *found["distortion_coefficients"]["data"][:4], found["readout"]])
        sigma = np.array(list(found["standard_deviations"].values())[: len(values)])
        off = float(np.max(np.abs(values - case.truth.values) / sigma))
        lens = Lens.of(case.truth.camera).moved(values - Lens.of(case.truth.camera).values)
        worse = held_out_error(case, lens.camera, lens.readout) / held_out_error(case, None, 0.0)
    else:
        off, worse = 0.0, 1.0
        reason = next((line for line in lines if "expected" in line), "no reason")
        report.notes.append(f"{case.name}: refused (status {status}): {reason}")
    yield Bound(f"{case.name}: largest error by its deviation, 0 refused", MAX_SIGMAS, off, "")
    yield Bound(f"{case.name}: held-out median error, by that of the given lens", MAX_WORSE, worse, "")


def held_out_error(case: Case, camera: Camera | None, readout: float) -> float:
    """Return the median error in m of the held-out stretch, localised with a camera, or with what its bag says."""
    bag, output = case.held_out, case.held_out.with_name("poses.tum")
    if camera is not None:
        bag = case.held_out.with_name("held_out_refined")
        relabel(case.held_out, bag, camera)
    output.unlink(missing_ok=True)
    call("localize", case.map, bag, "-o", output, "--set", f"camera.readout={readout}")
    return float(evaluate_poses(read_tum(output), read_poses(case.held_out, TRUTH)).report["translation_m"]["median"])


def relabel(bag: Path, output: Path, camera: Camera) -> None:
    """Copy images and their camera_info, the latter with another camera."""
    with BagReader(bag) as reader, BagWriter(output) as writer:
        names = {item.topic for item in reader.messages() if item.topic.endswith(("image_raw", "camera_info"))}
        for item in reader.messages(sorted(names)):
            message, stamp = item.message, stamp_ns(item.message)
            if item.topic.endswith("camera_info"):
                message = camera_to_info(camera, stamp, message.header.frame_id)
            writer.write(item.topic, message, stamp)


def readout_bounds(world: SphereWorld, folder: Path, report: Report, seed: int) -> Iterator[Bound]:
    """Yield what a true readout brings to the map, and to a drive in it, by the poses of the middle rows.

    Beside it the same by what a reconstruction by a global shutter would call the truth: COLMAP's poses are such.
    """
    how, part = Recorded(SMALL, SMALL, READOUT_S), folder / "readout"
    record(part / "taught", world, how, Sway(seed + 21), 0.0, 40)
    record(part / "driven", world, how, Sway(seed + 22), 0.0, 30)
    taught, driven = (read_poses(part / name, TRUTH) for name in ("taught", "driven"))
    bent = [bend(part / name, truth, READOUT_S) for name, truth in (("taught", taught), ("driven", driven))]
    of_map, of_drive = {}, {}
    for mapped in (0.0, READOUT_S):
        made, way = part / f"map_{mapped}", part / f"map_{mapped}.tum"
        call("map", part / "taught", "-o", made, "--trajectory", way, "--set", f"camera.readout={mapped}")
        placed = read_tum(way)
        T, T_bent = (
            fit_poses(truth.at(placed.stamps_ns, max_gap_ns=ROW_NS)[0].T_map_body, placed.T_map_body)
            for truth in (taught, bent[0])
        )
        of_map[mapped] = evaluate_poses(placed.moved(T), taught).report["translation_m"]["median"]
        for driving in (0.0, READOUT_S):
            output = part / f"poses_{mapped}_{driving}.tum"
            call("localize", made, part / "driven", "-o", output, "--set", f"camera.readout={driving}")
            judged = evaluate_poses(read_tum(output).moved(T), driven).report
            of_drive[mapped, driving] = judged["translation_m"]["median"]
            by_bent = evaluate_poses(read_tum(output).moved(T_bent), bent[1]).report
            report.notes.append(
                f"readout {1e3 * mapped:.0f} ms mapping, {1e3 * driving:.0f} ms localising: map "
                f"{1e3 * of_map[mapped]:.1f} mm, drive {1e3 * of_drive[mapped, driving]:.1f} mm, "
                f"{judged['rotation_deg']['median']:.2f} deg; by the truth of a global shutter "
                f"{1e3 * by_bent['translation_m']['median']:.1f} mm, {by_bent['rotation_deg']['median']:.2f} deg"
            )
    print("\n".join(report.notes), flush=True)
    none, both = of_drive[0.0, 0.0], of_drive[READOUT_S, READOUT_S]
    yield Bound("true readout, median error of the map by that without", 1.0, of_map[READOUT_S] / of_map[0.0], "")
    yield Bound("true readout, median error of the drive by that without", 1.0, both / none, "")
