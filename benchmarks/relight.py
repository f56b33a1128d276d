"""A recorded room in other light, made by its depth and poses: what one extension of the map is worth.

A map is made of every third image; another drive of the next ones is seen in another light and extends it; a third
drive in that light is localised in the map alone, in the extended one, and in a map of that light alone; and the first
light in the extended map. Light is of the world: shadows lie on the geometry, patches are anchored to it, a torch
moves with the camera. Parameters were chosen by the lights and images of `dev`.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import describe
from benchmarks.report import Bound, Report, Table
from benchmarks.rgbd_data import Calibration, Recording, colmap_poses, open_recording
from sphere_nav.cli.main import main as sphere_nav
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.trajectory import read_tum
from sphere_nav.offline.evaluation import evaluate_poses
from sphere_nav.offline.pose_bags import read_poses

HELP = "a recorded room in other light: images placed before and after one extension of the map"
LIGHTS = {  # what, share of the other light, seed of its directions and patches
    "dev": (("lamp", 1.0, 1), ("season", 0.6, 2), ("season", 0.85, 2), ("season", 1.0, 2)),
    "report": (("lamp", 1.0, 11), ("season", 0.6, 12), ("season", 0.85, 12), ("season", 1.0, 12), ("season", 1.0, 13)),
}
FRAMES = {"dev": 120, "report": 0}  # the first one; drives are every third of 120 from there, and from the next two
LENGTH, STEP = 120, 3
MAX_WORSE = 1.5  # error by that of the map of that light alone
WRONG = 0.1, 5.0  # m, deg: a pose that is wrong
CELL_M, BIAS_M = 0.02, 0.06  # of the map of shadows: side of a cell; what is nearer to the occluder is lit
PATCH_M = 0.7  # wavelength of patches of which the contrast is inverted
INVERTED = 0.35  # share of the surface that they take
BLUR_PX = 12.0  # of the mean about which it is inverted, at 640 x 480
NORMAL_PX = 4.0  # over which normals are smoothed: ranges are rough
Gray = NDArray[np.float32]


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--room", type=Path, default=Path("../shared/data/rgbd/redkitchen"), help="7-Scenes folder")
    parser.add_argument("--lights", choices=LIGHTS, default="report", help="dev: by which parameters were chosen")
    parser.add_argument("--light", type=int, nargs="*", help="numbers of the lights, from 0 (all)")
    parser.add_argument("--keep", type=Path, help="folder for bags and maps, that of an earlier run (none)")


def run(options: argparse.Namespace) -> Report:
    """Measure every light."""
    poses = colmap_poses(options.room)
    if poses is None or not options.room.is_dir():
        return Report("relight", skipped=f"no {options.room} with COLMAP's poses beside it")
    chosen = LIGHTS[options.lights][-1:] if options.quick else LIGHTS[options.lights]
    chosen = tuple(chosen[number] for number in options.light) if options.light else chosen
    report = Report("relight", notes=[describe(options.threads), f"lights: {options.lights}"])
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.keep or Path(temporary)
        room = Room(options.room, poses, FRAMES[options.lights], folder)
        own = room.base()
        rows = [room.measure(*light, own, report) for light in chosen]
    columns = ("light", "map alone", "extension", "after it", "own map", "first light before", "first light after")
    report.tables.append(Table("Images placed, wrong ones, median error", columns, rows))
    return report


@dataclass(frozen=True)
class Placed:
    """What `localize` made of a drive."""

    num_images: int
    states: dict[str, int]
    num_wrong: int
    median_mm: float

    @property
    def placed(self) -> int:
        """Images with a pose: TRACKING and DEGRADED."""
        return self.states.get("TRACKING", 0) + self.states.get("DEGRADED", 0)

    def __str__(self) -> str:
        tracking = f"{self.placed} of {self.num_images} ({self.states.get('TRACKING', 0)} TRACKING)"
        return f"{tracking}, {self.num_wrong} wrong, {self.median_mm:.1f} mm"


class Room:
    """A recording of a room, and what the commands make of it in a folder."""

    def __init__(self, data: Path, poses: Path, first: int, folder: Path) -> None:
        self._data, self._poses, self._first, self.folder = data, poses, first, folder
        self.recording = open_recording(data, poses)
        self.calibration = self.recording.calibrations[-1]
        folder.mkdir(parents=True, exist_ok=True)

    def base(self) -> Placed:
        """Map the first drive in its own light, localise the third one in it."""
        for number in (0, 2):
            self.drive("day", None, number)
        if not (self.folder / "map_day").exists():
            self._map("day_0", "map_day")
        return self.localize("map_day", "day_2")

    def measure(self, kind: str, share: float, seed: int, day: Placed, report: Report) -> tuple[str, ...]:
        """Measure one light; return its row."""
        name = f"{kind}{round(100 * share)}_{seed}"
        light = Light(kind, share, seed, self.recording, self.calibration, self.pose_files(0))
        for number in (1, 2):
            self.drive(name, light, number)
        alone = self.localize("map_day", f"{name}_2")
        self._map(f"{name}_1", f"map_{name}_own")
        own = self.localize(f"map_{name}_own", f"{name}_2")
        said = self._map(f"{name}_1", f"map_{name}", "--extend", self.folder / "map_day", "--experience", name)
        if "refused" in said:
            after, first = Placed(day.num_images, {}, 0, np.nan), day
        else:
            after, first = self.localize(f"map_{name}", f"{name}_2"), self.localize(f"map_{name}", "day_2")
        what = f"{kind} {share:.0%}, seed {seed}"
        report.bounds += [
            Bound(f"{what}: images placed, at least as by its own map", own.placed, after.placed, "", True),
            Bound(f"{what}: wrong", 0, after.num_wrong + first.num_wrong, ""),
            Bound(f"{what}: median error", MAX_WORSE * own.median_mm, after.median_mm, "mm"),
            Bound(f"{what}: the first light placed", day.placed, first.placed, "", True),
            Bound(f"{what}: its median error", 1.05 * day.median_mm + 0.05, first.median_mm, "mm"),
        ]
        return what, str(alone), said, str(after), str(own), str(day), str(first)

    def pose_files(self, number: int) -> list[Path]:
        """Return the files of the true poses of a drive."""
        first = self._first + number
        last = self._first + LENGTH
        return [self._poses / f"frame-{index:06d}.pose.txt" for index in range(first, last, STEP)]

    def drive(self, name: str, light: Any, number: int) -> None:
        """Make a bag of a drive in a light."""
        bag, folder = self.folder / f"{name}_{number}", self.folder / f"{name}_{number}_images"
        if bag.exists():
            return
        folder.mkdir()
        for path in self.pose_files(number):
            stem = path.name.removesuffix(".pose.txt")
            frame = self.recording.frame(path, self.calibration)
            gray = frame.gray.astype(np.float32)
            gray = gray if light is None else light.shine(gray, frame.depth_m, frame.T_world_camera)
            cv2.imwrite(str(folder / f"{stem}.color.png"), np.clip(np.rint(gray), 1, 255).astype(np.uint8))
            for source in (self._data / f"{stem}.depth.png", path):
                shutil.copy(source, folder / source.name)
        status, said = call("import", "seven_scenes", folder, "-o", bag, "--truth-camera", "colour")
        if status:
            raise ValueError(f"{bag}: {said}")
        shutil.rmtree(folder)

    def _map(self, drive: str, name: str, *words: Any) -> str:
        """Make a map; return what was said of the joining, or why it was refused."""
        target = self.folder / name
        if target.exists():
            shutil.rmtree(target)
        anchor = () if words else ("--anchor", "truth")
        status, said = call("map", self.folder / drive, "-o", target, *anchor, *words)
        if status:
            return f"refused: {said.strip().splitlines()[-1]}"
        return next((line for line in said.splitlines() if line.startswith("joined")), "")

    def localize(self, name: str, drive: str, *words: str) -> Placed:
        """Localise a drive, judged by its truth; more words for the command."""
        poses, summary = self.folder / "poses.tum", self.folder / "summary.json"
        given = "localize", self.folder / name, self.folder / drive, "-o", poses, "--json", summary, "--overwrite"
        call(*given, *words)
        found = json.loads(summary.read_text(encoding="utf-8"))
        if not found["poses"]:
            return Placed(found["images"], found["states"], 0, np.nan)
        errors = evaluate_poses(read_tum(poses), read_poses(self.folder / drive, ("ground_truth/pose",))).errors
        is_wrong = (errors.translation_m > WRONG[0]) | (np.degrees(errors.rotation_rad) > WRONG[1])
        median = 1e3 * float(np.median(errors.translation_m))
        return Placed(found["images"], found["states"], int(is_wrong.sum()), median)


class Light:
    """Another light of a room: what a camera at a pose would see of its surfaces by it."""

    def __init__(
        self, kind: str, share: float, seed: int, recording: Recording, calibration: Calibration, poses: Sequence[Path]
    ) -> None:
        self._kind, self._share, self._camera = kind, share, calibration.camera
        random = np.random.default_rng(seed)
        frames = [recording.frame(path, calibration) for path in poses[::5]]
        points = [self._points(frame.depth_m)[0][::4, ::4].reshape(-1, 3) for frame in frames]
        clouds = [frame.T_world_camera.apply(one) for frame, one in zip(frames, points, strict=True)]
        world = np.concatenate(clouds)
        up = -np.mean([frame.T_world_camera.rotation[:, 1] for frame in frames], axis=0)
        back = -np.mean([frame.T_world_camera.rotation[:, 2] for frame in frames], axis=0)
        self._lamp = np.mean(world, axis=0) + random.normal(0.0, 0.5, 3) + 0.7 * up + 0.8 * back
        direction = up + random.uniform(0.2, 0.9) * back + random.normal(0.0, 0.5, 3)
        self._sun = direction / np.linalg.norm(direction)
        self._waves = random.normal(0.0, 2.0 * np.pi / PATCH_M, (6, 3)), random.uniform(0.0, 2.0 * np.pi, 6)
        self._shadow_map(world)

    def shine(self, gray: Gray, depth_m: Gray, T_world_camera: Any) -> Gray:
        """Return the image in this light."""
        points, normals = self._points(depth_m)
        world = points @ T_world_camera.rotation.T + T_world_camera.translation
        facing = normals @ T_world_camera.rotation.T
        light = self._light(world, facing, points, normals)
        albedo = gray if self._kind == "lamp" else self._patches(gray, world)
        other = np.clip(albedo * light, 1.0, 255.0)
        return ((1.0 - self._share) * gray + self._share * other).astype(np.float32)

    def _light(self, world: Array, facing: Array, points: Array, normals: Array) -> Array:
        """Return the brightness (H, W) by lamp, or by sun and torch."""
        if self._kind == "lamp":
            away = self._lamp - world
            distance = np.linalg.norm(away, axis=-1)
            lit = np.abs(np.sum(away * facing, axis=-1)) / distance / np.maximum(distance, 0.5) ** 2
            return 0.35 + 1.6 * lit
        sun = np.maximum(np.sum(facing * self._sun, axis=-1), 0.15) * self._is_lit(world)
        distance = np.linalg.norm(points, axis=-1)
        beam = np.exp(-((points[..., 0] / points[..., 2]) ** 2 + (points[..., 1] / points[..., 2]) ** 2) / 0.18)
        torch = beam * np.abs(np.sum(points * normals, axis=-1)) / distance / np.maximum(distance, 0.7) ** 2
        return 0.30 + 1.0 * sun + 1.1 * torch

    def _patches(self, gray: Gray, world: Array) -> Gray:
        """Return the albedo with the contrast of part of the surfaces inverted."""
        vectors, phases = self._waves
        noise = np.sin(world @ vectors.T + phases).sum(axis=-1)
        mean = cv2.GaussianBlur(gray, (0, 0), BLUR_PX)
        return np.where(noise > np.sqrt(6 / 2) * 0.385, 2.0 * mean - gray, gray).astype(np.float32)  # INVERTED above

    def _points(self, depth_m: Gray) -> tuple[Array, Array]:
        """Return the points (H, W, 3) of an image, holes filled by what is nearest, and normals towards the camera."""
        unknown = np.isnan(depth_m).astype(np.uint8)
        _, label = cv2.distanceTransformWithLabels(unknown, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
        values = np.zeros(label.max() + 1, np.float32)
        values[label[unknown == 0]] = depth_m[unknown == 0]
        depth = cv2.bilateralFilter(cv2.medianBlur(values[label], 5), 9, 0.05, 5.0)
        v, u = np.indices(depth.shape)
        camera = self._camera
        rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], axis=-1)
        points = rays * depth[..., None]
        across, down = np.gradient(points, axis=1), np.gradient(points, axis=0)
        normals = cv2.GaussianBlur(np.cross(down, across) / depth[..., None] ** 2, (0, 0), NORMAL_PX)
        normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-9)
        return points, np.where(np.sum(normals * points, axis=-1, keepdims=True) > 0, -normals, normals)

    def _shadow_map(self, world: Array) -> None:
        """Take down what is nearest to the sun in every cell across its direction."""
        side = np.cross(self._sun, [0.3, 0.5, 0.8])
        side /= np.linalg.norm(side)
        self._axes = np.stack([side, np.cross(self._sun, side), self._sun])
        u, v, height = (world @ self._axes.T).T
        self._corner = np.array([u.min(), v.min()])
        shape = tuple(np.ceil((np.array([v.max(), u.max()]) - self._corner[::-1]) / CELL_M).astype(int) + 1)
        top = np.full(shape, -1e9, np.float32)
        row, column = ((v - self._corner[1]) / CELL_M).astype(int), ((u - self._corner[0]) / CELL_M).astype(int)
        np.maximum.at(top, (row, column), height)
        self._top = cv2.dilate(top, np.ones((3, 3), np.uint8))

    def _is_lit(self, world: Array) -> Array:
        """Return which points (H, W, 3) the sun reaches."""
        u, v, height = np.moveaxis(world @ self._axes.T, -1, 0)
        row = np.clip((v - self._corner[1]) / CELL_M, 0, self._top.shape[0] - 1).astype(int)
        column = np.clip((u - self._corner[0]) / CELL_M, 0, self._top.shape[1] - 1).astype(int)
        return height > self._top[row, column] - BIAS_M


def call(*words: Any) -> tuple[int, str]:
    """Run a command; return its exit code and what it printed, errors included."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        status = sphere_nav([str(word) for word in words])
    return status, said.getvalue()
