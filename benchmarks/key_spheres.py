"""When a sphere becomes a key sphere: eq. 12 of M15 alone, and with the rules that are in force beside it.

Towns: a drive of spheres a metre apart, drawn with noise of image and range as in `long_map`; then cameras half way
between the spheres, turned any way, are aligned with the two nearest key spheres from a guess 0.1 m and 1 degree off,
and judged as the localiser does. Key spheres stand at their true poses there, so that spacing is all that differs.
Recordings: every second frame is mapped (of redkitchen up to 120), those between are localised, through the commands.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.end_to_end import KITCHEN_READOUT, TRUTH, call, errors
from benchmarks.long_map import HEIGHT_M, draw
from benchmarks.machine import describe
from benchmarks.region import CAMERA, PARAMS, localise, noisy
from benchmarks.report import Bound, Report, Table
from benchmarks.rgbd_data import colmap_poses
from cycab_sim.params import LightParams, RenderParams
from cycab_sim.rendering.renderer import Renderer
from cycab_sim.world.worlds import build_world
from sphere_mapping.mapper import Mapper
from sphere_mapping.params import MapperParams
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.trajectory import read_tum
from sphere_nav.params import build
from sphere_nav.photometric import View, prepare_reference
from sphere_nav.ros.maps.reader import open_map
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, Sphere
from sphere_nav_tools.offline.evaluation import evaluate_poses as judge_poses
from sphere_nav_tools.offline.pose_bags import read_poses

HELP = "spacing of key spheres and what it costs: eq. 12 alone against the rules in force, in towns and on recordings"
NEVER = 1e6
ALONE = {"key.max_parallax": NEVER, "key.max_parallax_whole": NEVER, "key.min_overlap": 0.0}
RULES: dict[str, dict[str, Any]] = {
    "in force": {},
    "eq. 12 alone, 5 %": ALONE,
    "eq. 12 alone, 3 %": ALONE | {"key.max_mad_share": 0.03},
}
LENGTH_M, QUICK_M, WIDTH = 60.0, 15.0, 512  # of the drive; of its spheres in px
WRONG_M = 0.1
COLUMNS = ("place", "rule", "kept", "spacing m, median", "largest", "chain off %", "localised %", "median mm", "p95 mm")


@dataclass(frozen=True)
class Outcome:
    """What a rule did on a drive: gaps between key spheres in m, error of the way in % of it, poses in the map."""

    gaps_m: Array
    off_percent: float
    num_tried: int
    errors_m: Array  # of those that were localised

    @property
    def right(self) -> float:
        """Share of the tried ones that were localised to 0.1 m."""
        return float(np.sum(self.errors_m < WRONG_M)) / max(self.num_tried, 1)

    def cells(self, place: str, rule: str) -> tuple[str, ...]:
        """Return a row of the table."""
        gaps = (f"{np.median(self.gaps_m):.2f}", f"{self.gaps_m.max():.2f}") if self.gaps_m.size else ("-", "-")
        known = self.errors_m.size
        poses = (f"{1e3 * np.median(self.errors_m):.1f}", f"{1e3 * np.quantile(self.errors_m, 0.95):.1f}")
        share = f"{100 * known / max(self.num_tried, 1):.1f}"
        kept = str(self.gaps_m.size + 1)
        return place, rule, kept, *gaps, f"{self.off_percent:.2f}", share, *(poses if known else ("-", "-"))


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments; recordings are found as `end_to_end` finds them."""
    parser.add_argument("--key-seeds", type=int, nargs="*", default=[61, 62], help="of towns (61 62)")


def run(options: argparse.Namespace) -> Report:
    """Drive through every town and map every recording by every rule."""
    report = Report("key_spheres", notes=[describe(options.threads), __doc__ or ""])
    found: dict[str, dict[str, Outcome]] = {}
    for seed in options.key_seeds[:1] if options.quick else options.key_seeds:
        found[f"town {seed}"] = in_town(seed, QUICK_M if options.quick else LENGTH_M)
    for name, measure in (("driving/kitti_06", kitti), ("rgbd/redkitchen", kitchen)):
        data = options.recordings / name
        if options.quick or not data.is_dir() or (measure is kitchen and colmap_poses(data) is None):
            report.notes.append(f"{name}: skipped{'' if options.quick else f', no folder {data}'}")
            continue
        found[data.name] = {}
        for rule in list(RULES)[:2]:
            with tempfile.TemporaryDirectory() as folder:
                found[data.name][rule] = measure(data, Path(folder), RULES[rule])
    rows = [outcome.cells(place, rule) for place, rules in found.items() for rule, outcome in rules.items()]
    report.tables.append(Table("Key spheres by rule", COLUMNS, rows))
    for place, rules in found.items():
        ours, paper = (rules[rule] for rule in list(RULES)[:2])
        report.bounds += [
            Bound(f"{place}: rules in force, localised to {WRONG_M} m, less than by eq. 12 alone", 1.0,
                  100 * (paper.right - ours.right), "%"),
        ]  # fmt: skip
    return report


def in_town(seed: int, length: float) -> dict[str, Outcome]:
    """Return what every rule does on a drive through a town."""
    world = build_world("town", seed, "block")
    renderer = Renderer(world.mesh, RenderParams(), LightParams(), num_threads=1)
    above = SE3.from_parts(np.eye(3), [0.0, 0.0, HEIGHT_M])
    places = np.arange(0.0, min(length, float(world.path.length) - 1.0), 0.5)
    poses = [SE3.from_planar(float(x), float(y), float(yaw)) @ above for x, y, yaw, _ in world.path.at(places)]
    rng = np.random.default_rng([seed, 9])
    drawn = enumerate(poses[::2])
    spheres = [draw(renderer, pose, Spherical(WIDTH, WIDTH // 2), index, rng) for index, pose in drawn]
    cameras = [pose @ SE3.exp([0, 0, 0, 0, 0, rng.uniform(-np.pi, np.pi)]) @ T_BODY_OPTICAL for pose in poses[1::2]]
    images = [noisy(renderer.render(CAMERA, pose, is_gray=True)[0], rng) for pose in cameras]
    return {rule: _outcome(spheres, poses[::2], images, cameras, values) for rule, values in RULES.items()}


def _outcome(
    spheres: Sequence[Sphere],
    truth: Sequence[SE3],
    images: Sequence[NDArray[np.uint8]],
    cameras: Sequence[SE3],
    values: Mapping[str, Any],
) -> Outcome:
    """Map the spheres by a rule, then localise the images by the key spheres where these truly are."""
    mapper = Mapper(build(MapperParams, {"loop.automatic": False} | dict(values)))
    for sphere in spheres:
        mapper.add(sphere)
    mapper.keep_end()
    placed = {sphere.stamp_ns: pose for sphere, pose in zip(spheres, truth, strict=True)}
    keys = [placed[node.stamp_ns] for node in mapper.graph]
    stamps, found = zip(*mapper.trajectory(), strict=True)
    T_truth_map, way = truth[0] @ found[0].inverse(), _gaps(truth).sum()
    off = placed[stamps[-1]].distance(T_truth_map @ found[-1])[0] / way
    references = [prepare_reference(one.gray, one.range_m, one.camera, PARAMS.registration)
                  for one in (mapper.load_sphere(node.id) for node in mapper.graph)]  # fmt: skip
    views = [View(reference, pose) for reference, pose in zip(references, keys, strict=True)]
    rng = np.random.default_rng(0)
    tried = [localise(image, _nearest(views, at), at, rng) for image, at in zip(images, cameras, strict=True)]
    return Outcome(_gaps(keys), 100 * float(off), len(tried), np.array([one[0] for one in tried if one is not None]))


def _nearest(views: Sequence[View], T_camera: SE3) -> list[View]:
    """Return the two key spheres nearest to a camera."""
    return sorted(views, key=lambda view: float(view.T_world_reference.distance(T_camera)[0]))[:2]


def kitti(data: Path, folder: Path, values: Mapping[str, Any]) -> Outcome:
    """Map the even frames of a stereo drive, localise the odd ones by the left image."""
    for name, frames in (("even", "0:51:2"), ("odd", "1:51:2")):
        call("import", "kitti", data, "-o", folder / name, "--frames", frames)
    topics = ("--image", "left/image_raw", "--info", "left/camera_info")
    return _by_commands(folder, values, (), topics)


def kitchen(data: Path, folder: Path, values: Mapping[str, Any]) -> Outcome:
    """Map the even frames of an RGB-D camera, localise the odd ones by colour."""
    truth = ("--poses", colmap_poses(data), "--truth-camera", "colour")
    for name, frames in (("even", "0:120:2"), ("odd", "1:120:2")):
        call("import", "seven_scenes", data, "-o", folder / name, "--frames", frames, *truth)
    return _by_commands(folder, values, ("--set", KITCHEN_READOUT), ("--set", KITCHEN_READOUT))


def _by_commands(folder: Path, values: Mapping[str, Any], of_map: Sequence[str], of_localize: Sequence[str]) -> Outcome:
    """Map `even` in a folder by a rule, and localise `odd` in it."""
    rule = [word for name, value in values.items() for word in ("--set", f"mapper.{name}={value}")]
    way = ("--trajectory", folder / "even.tum")
    call("map", folder / "even", "-o", folder / "map", "--anchor", "truth", *way, *of_map, *rule)
    call("localize", folder / "map", folder / "odd", "-o", folder / "odd.tum", *of_localize)
    truth, odd = (read_poses(folder / name, TRUTH) for name in ("even", "odd"))
    mapped = judge_poses(read_tum(folder / "even.tum"), truth).errors.translation_m
    with open_map(folder / "map") as reader:
        keys = [node.T_map_sphere for node in reader.graph]
    off = float(np.sqrt(np.mean(mapped**2))) / truth.distances[-1]
    return Outcome(_gaps(keys), 100 * off, len(odd), errors(read_tum(folder / "odd.tum"), odd))


def _gaps(poses: Sequence[SE3]) -> Array:
    """Return the distances in m from one pose to the next."""
    return np.array([float(a.distance(b)[0]) for a, b in pairwise(poses)])
