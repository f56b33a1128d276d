"""A recorded street in other light, made by its stereo and poses: what one extension of the map is worth.

A map is made of every second image pair; the others, in another light, extend it; the left images of the first ones in
that light are localised in the map alone, in the extended one, and in a map of that light alone.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.machine import describe
from benchmarks.other_light import STREET, Gray, Light
from benchmarks.relight import Placed, call
from benchmarks.report import Bound, Report, Table
from benchmarks.rgbd_data import Frame
from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import read_tum
from sphere_nav.offline.evaluation import evaluate_poses
from sphere_nav.offline.importing.kitti import KittiRecording
from sphere_nav.offline.pose_bags import read_poses

HELP = "a recorded street in other light: images placed before and after one extension of the map"
LIGHTS: tuple[tuple[str, float, int], ...] = (  # what, share of the other light, seed of its directions and patches
    ("season", 0.6, 12),
    ("season", 0.85, 12),
    ("season", 1.0, 12),
    ("season", 1.0, 13),
    ("lamp", 1.0, 11),
)
MAX_WORSE = 1.5  # error by that of the map of that light alone
WRONG = 0.5, 5.0  # m, deg: a pose that is wrong
FARTHEST_M = 80.0  # stereo tells no more of what is beyond
TOPICS = "--image", "left/image_raw", "--info", "left/camera_info"


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments; `--light` and `--keep` are those of relight."""
    parser.add_argument("--kitti", type=Path, default=Path("../shared/data/driving/kitti_06"), help="KITTI sequence")


def run(options: argparse.Namespace) -> Report:
    """Measure every light."""
    if not options.kitti.is_dir():
        return Report("relight_street", skipped=f"no {options.kitti}")
    chosen = LIGHTS[2:3] if options.quick else LIGHTS
    chosen = tuple(chosen[number] for number in options.light) if options.light else chosen
    report = Report("relight_street", notes=[describe(options.threads)])
    with tempfile.TemporaryDirectory() as temporary:
        street = Street(options.kitti, options.keep or Path(temporary))
        day = street.base()
        rows = [street.measure(*light, day, report) for light in chosen]
    columns = ("light", "map alone", "extension", "after it", "own map", "first light before", "first light after")
    report.tables.append(Table("Images placed, wrong ones, median error", columns, rows))
    return report


class Street:
    """A recording of a street by a stereo pair, and what the commands make of it in a folder."""

    def __init__(self, data: Path, folder: Path) -> None:
        self._data, self.folder = data, folder
        self.recording = KittiRecording(data)
        if self.recording.poses is None:
            raise ValueError(f"{data / 'poses.txt'}: expected the true poses, found none")
        folder.mkdir(parents=True, exist_ok=True)

    def base(self) -> Placed:
        """Map every second pair in its own light, localise the others in it."""
        for name, first in (("day", 0), ("day_others", 1)):
            self._import(self._data, name, first)
        if not (self.folder / "map_day").exists():
            self._map("day", "map_day")
        return self.localize("map_day", "day_others")

    def measure(self, kind: str, share: float, seed: int, day: Placed, report: Report) -> tuple[str, ...]:
        """Measure one light; return its row."""
        name = f"{kind}{round(100 * share)}_{seed}"
        self._drives(name, kind, share, seed)
        alone = self.localize("map_day", name)
        self._map(f"{name}_others", f"map_{name}_own")
        own = self.localize(f"map_{name}_own", name)
        said = self._map(f"{name}_others", f"map_{name}", "--extend", self.folder / "map_day", "--experience", name)
        if "refused" in said:
            after, first = Placed(own.num_images, {}, 0, np.nan), day
        else:
            after, first = self.localize(f"map_{name}", name), self.localize(f"map_{name}", "day_others")
        what = f"{kind} {share:.0%}, seed {seed}"
        report.bounds += [
            Bound(f"{what}: images placed, at least as by its own map", own.placed, after.placed, "", True),
            Bound(f"{what}: wrong", 0, after.num_wrong + first.num_wrong, ""),
            Bound(f"{what}: median error", MAX_WORSE * own.median_mm, after.median_mm, "mm"),
            Bound(f"{what}: the first light placed", day.placed, first.placed, "", True),
            Bound(f"{what}: its median error", 1.05 * day.median_mm + 0.05, first.median_mm, "mm"),
        ]
        return what, str(alone), said, str(after), str(own), str(day), str(first)

    def frame(self, index: int, *, is_left: bool) -> Frame:
        """Return an image with its depth by the pair, and its pose."""
        recording = self.recording
        left, right = (_gray(folder / recording.images[index].name) for folder in (recording.left, recording.right))
        assert recording.poses is not None
        T_world_left = SE3.from_matrix(np.vstack([recording.poses[index].reshape(3, 4), (0, 0, 0, 1)]))
        focal_m = recording.camera.fx * recording.baseline
        if is_left:
            return Frame(f"{index}", left, depth(left, right, focal_m), T_world_left)
        mirrored = depth(right[:, ::-1].copy(), left[:, ::-1].copy(), focal_m)[:, ::-1]
        T_left_right = SE3.from_parts(np.eye(3), [recording.baseline, 0.0, 0.0])
        return Frame(f"{index}", right, mirrored, T_world_left @ T_left_right)

    def _drives(self, name: str, kind: str, share: float, seed: int) -> None:
        """Make the bags of every second pair in a light, and of the others."""
        folder = self.folder / f"{name}_images"
        if (self.folder / f"{name}_others").exists():
            return
        shutil.rmtree(folder, ignore_errors=True)
        count, recording = self.recording.num_frames, self.recording
        seen = [self.frame(index, is_left=True) for index in range(0, count, 5)]
        light = Light(kind, share, seed, seen, recording.camera, STREET)
        for camera in (recording.left, recording.right):
            (folder / camera.name).mkdir(parents=True)
            for index in range(count):
                one = self.frame(index, is_left=camera is recording.left)
                gray: Gray = light.shine(one.gray.astype(np.float32), one.depth_m, one.T_world_camera)
                path = folder / camera.name / recording.images[index].name
                cv2.imwrite(str(path), np.clip(np.rint(gray), 1, 255).astype(np.uint8))
        for file in ("calib.txt", "times.txt", "poses.txt"):
            shutil.copy(self._data / file, folder / file)
        self._import(folder, name, 0)
        self._import(folder, f"{name}_others", 1)

    def _import(self, data: Path, name: str, first: int) -> None:
        if not (self.folder / name).exists():
            frames = f"{first}:{self.recording.num_frames}:2"
            status, said = call("import", "kitti", data, "-o", self.folder / name, "--frames", frames)
            if status:
                raise ValueError(f"{name}: {said}")

    def _map(self, drive: str, name: str, *words: Any) -> str:
        """Make a map; return what was said of the joining, or why it was refused."""
        target = self.folder / name
        for remains in (target, target.with_name(f"{name}.partial")):
            shutil.rmtree(remains, ignore_errors=True)
        anchor = () if words else ("--anchor", "truth")
        status, said = call("map", self.folder / drive, "-o", target, *anchor, *words)
        if status:
            return f"refused: {said.strip().splitlines()[-1].replace(f'{self.folder}/', '')}"
        told = next((line for line in said.splitlines() if line.startswith("joined")), "")
        return told.replace(f"{self.folder}/", "")

    def localize(self, name: str, drive: str) -> Placed:
        """Localise the left images of a drive, judged by the truth."""
        poses, summary = self.folder / "poses.tum", self.folder / "summary.json"
        given = "localize", self.folder / name, self.folder / drive, "-o", poses, "--json", summary, "--overwrite"
        call(*given, *TOPICS)
        found = json.loads(summary.read_text(encoding="utf-8"))
        if not found["poses"]:
            return Placed(found["images"], found["states"], 0, np.nan)
        errors = evaluate_poses(read_tum(poses), read_poses(self.folder / drive, ("ground_truth/pose",))).errors
        is_wrong = (errors.translation_m > WRONG[0]) | (np.degrees(errors.rotation_rad) > WRONG[1])
        return Placed(
            found["images"], found["states"], int(is_wrong.sum()), 1e3 * float(np.median(errors.translation_m))
        )


def depth(near: Any, other: Any, focal_m: float) -> Gray:
    """Return the depth (H, W) m of a left image by its right one, NaN where it is not found."""
    matcher = cv2.StereoSGBM_create(
        minDisparity=0, numDisparities=128, blockSize=5, P1=200, P2=3200, disp12MaxDiff=1, uniquenessRatio=5,
        speckleWindowSize=100, speckleRange=2, mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )  # fmt: skip
    disparity = matcher.compute(near, other).astype(np.float32) / 16
    found = np.where(disparity > focal_m / FARTHEST_M, focal_m / np.maximum(disparity, 1e-3), np.nan)
    return found.astype(np.float32)


def _gray(path: Path) -> Any:
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise ValueError(f"{path}: expected an image, found none that can be read")
    return image
