"""A recorded street in other light, made by its stereo and poses: what one extension of the map is worth.

A map is made of every second image pair; the others, in another light, extend it; the left images of the first ones in
that light are localised in the map alone, in the extended one, and in a map of that light alone.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.machine import describe
from benchmarks.other_light import STREET, Gray, Light
from benchmarks.relight import COLUMNS, TITLE, Drives, Placed, Relit, call, name_of
from benchmarks.report import Report, Table
from benchmarks.rgbd_data import Frame
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav_tools.offline.importing.kitti import open_kitti

HELP = "a recorded street in other light: images placed before and after one extension of the map"
LIGHTS: tuple[tuple[str, float, int], ...] = (  # what, share of the other light, seed of its directions and patches
    ("season", 0.6, 12),
    ("season", 0.85, 12),
    ("season", 1.0, 12),
    ("season", 1.0, 13),
    ("lamp", 1.0, 11),
)
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
    report.tables.append(Table(TITLE, COLUMNS, rows))
    return report


class Street(Relit):
    """A recording of a street by a stereo pair in several lights."""

    wrong = WRONG
    topics = TOPICS

    def __init__(self, data: Path, folder: Path) -> None:
        super().__init__(folder)
        self._data = data
        self.recording = open_kitti(data)
        right = self.recording.views["right"]
        assert isinstance(right.camera, Pinhole)
        self.camera, self.baseline_m = right.camera, right.baseline_m
        if not self.recording.truth_name:
            raise ValueError(f"{data / 'poses.txt'}: expected the true poses, found none")

    def base(self) -> Placed:
        """Map every second pair in its own light, localise the others in it."""
        for name, first in (("day", 0), ("day_others", 1)):
            self._import(self._data, name, first)
        if not (self.folder / "map_day").exists():
            self._map("day", "map_day")
        return self.localize("map_day", "day_others")

    def measure(self, kind: str, share: float, seed: int, day: Placed, report: Report) -> tuple[str, ...]:
        """Measure one light; return its row."""
        name = name_of(kind, share, seed)
        self._drives(name, kind, share, seed)
        return self.compare((kind, share, seed), Drives(f"{name}_others", name, "day_others"), day, report)

    def frame(self, index: int, *, is_left: bool) -> Frame:
        """Return an image with its depth by the pair, and its pose."""
        instant = self.recording.instants[index]
        left, right = (_gray(Path(shot.where)) for shot in instant.images.values())
        assert instant.T_map_link is not None
        T_world_left = T_BODY_OPTICAL.inverse() @ instant.T_map_link @ T_BODY_OPTICAL
        focal_m = self.camera.fx * self.baseline_m
        if is_left:
            return Frame(f"{index}", left, depth(left, right, focal_m), T_world_left)
        mirrored = depth(right[:, ::-1].copy(), left[:, ::-1].copy(), focal_m)[:, ::-1]
        T_left_right = SE3.from_parts(np.eye(3), [self.baseline_m, 0.0, 0.0])
        return Frame(f"{index}", right, mirrored, T_world_left @ T_left_right)

    def _drives(self, name: str, kind: str, share: float, seed: int) -> None:
        """Make the bags of every second pair in a light, and of the others."""
        folder = self.folder / f"{name}_images"
        if (self.folder / f"{name}_others").exists():
            return
        shutil.rmtree(folder, ignore_errors=True)
        count = self.recording.num_frames
        seen = [self.frame(index, is_left=True) for index in range(0, count, 5)]
        light = Light(kind, share, seed, seen, self.camera, STREET)
        for side in self.recording.views:
            for index, instant in enumerate(self.recording.instants):
                one = self.frame(index, is_left=side == "left")
                gray: Gray = light.shine(one.gray.astype(np.float32), one.depth_m, one.T_world_camera)
                source = Path(instant.images[side].where)
                path = folder / source.parent.name / source.name
                path.parent.mkdir(parents=True, exist_ok=True)
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
