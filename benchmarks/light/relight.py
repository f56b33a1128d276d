"""A recorded room in other light, made by its depth and poses: what one extension is worth.

A map is made of some images; others, in another light, extend it; the rest in that light is localised in the map alone,
in the extended one, and in a map of that light alone; and the first light in the extended map. Lights follow from the
seed; parameters were chosen by other lights and other images of the room.
"""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.commands import TRUTH, call
from benchmarks.report import Bound, Headline, Report, Table
from benchmarks.rgbd_data import CAMERA, Frame, Recording
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.geometry.trajectory import read_tum
from sphere_nav_tools.offline.evaluation import evaluate_poses, read_poses

BLUR_PX = 12.0  # of the mean about which it is inverted, at 640 x 480
NORMAL_PX = 4.0  # over which normals are smoothed: ranges are rough
PATCH_M = 0.7  # wavelength of patches of which the contrast is inverted
CELL_M, BIAS_M = 0.02, 0.06  # side of a cell of the map of shadows; what is nearer to the occluder is lit
LAMP_M, NEAR_M = 1.0, 0.7  # how far a lamp lights; nearer than this a torch is no brighter
Gray = NDArray[np.float32]
LIGHTS = (("season", 0.6), ("season", 0.85), ("season", 1.0), ("lamp", 1.0))  # what, share of the other light
NUM_FRAMES, STEP = {"quick": 60, "full": 120}, 3  # drives in the room are every third of them, and the next two of each
MAX_WORSE = 1.5  # error by that of the map of that light alone
WRONG = (0.1, 5.0)  # m, deg
OF_OWN = "of what its own map places"
TITLE = "Images placed, wrong ones, median error"
COLUMNS = ("light", "map alone", "extension", "after it", "own map", "first light before", "first light after")


def torch_light(points: Array, normals: Array) -> Array:
    """Return the brightness (H, W) of points (H, W, 3) by a torch beside the lens."""
    distance = np.linalg.norm(points, axis=-1)
    beam = np.exp(-((points[..., 0] / points[..., 2]) ** 2 + (points[..., 1] / points[..., 2]) ** 2) / 0.18)
    shade = np.abs(np.sum(points * normals, axis=-1)) / distance
    return np.asarray(beam * shade / np.maximum(distance, NEAR_M) ** 2)


class Light:
    """Another light of a room: what a camera at a pose would see of its surfaces by it."""

    def __init__(self, kind: str, share: float, seed: int, frames: Sequence[Frame]) -> None:
        self._kind, self._share = kind, share
        random = np.random.default_rng(seed)
        points = [self._points(frame.depth_m)[0][::4, ::4].reshape(-1, 3) for frame in frames]
        clouds = [frame.T_world_camera.apply(one) for frame, one in zip(frames, points, strict=True)]
        world = np.concatenate(clouds)
        up = -np.mean([frame.T_world_camera.rotation[:, 1] for frame in frames], axis=0)
        back = -np.mean([frame.T_world_camera.rotation[:, 2] for frame in frames], axis=0)
        self._lamp = np.mean(world, axis=0) + LAMP_M * (random.normal(0.0, 0.5, 3) + 0.7 * up + 0.8 * back)
        direction = up + random.uniform(0.2, 0.9) * back + random.normal(0.0, 0.5, 3)
        self._sun = direction / np.linalg.norm(direction)
        self._waves = random.normal(0.0, 2.0 * np.pi / PATCH_M, (6, 3)), random.uniform(0.0, 2.0 * np.pi, 6)
        self._shadow_map(world)

    def shine(self, gray: Gray, depth_m: Gray, T_world_camera: SE3) -> Gray:
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
            lit = np.abs(np.sum(away * facing, axis=-1)) / distance / np.maximum(distance / LAMP_M, 0.5) ** 2
            return 0.35 + 1.6 * lit
        sun = np.maximum(np.sum(facing * self._sun, axis=-1), 0.15) * self._is_lit(world)
        return 0.30 + 1.0 * sun + 1.1 * torch_light(points, normals)

    def _patches(self, gray: Gray, world: Array) -> Gray:
        """Return the albedo with the contrast of part of the surfaces inverted."""
        vectors, phases = self._waves
        noise = np.sin(world @ vectors.T + phases).sum(axis=-1)
        mean = cv2.GaussianBlur(gray, (0, 0), BLUR_PX)
        is_inverted = noise > np.sqrt(6 / 2) * 0.385  # on 35 % of the surface
        return np.where(is_inverted, 2.0 * mean - gray, gray).astype(np.float32)

    def _points(self, depth_m: Gray) -> tuple[Array, Array]:
        """Return the points (H, W, 3) of an image, holes filled by what is nearest, and normals towards the camera."""
        unknown = np.isnan(depth_m).astype(np.uint8)
        _, label = cv2.distanceTransformWithLabels(unknown, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
        values = np.zeros(label.max() + 1, np.float32)
        values[label[unknown == 0]] = depth_m[unknown == 0]
        depth = cv2.bilateralFilter(cv2.medianBlur(values[label], 5), 9, 0.05, 5.0)
        rays = pixel_rays(CAMERA)
        points = rays / rays[..., 2:] * depth[..., None]
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
        row, column = self._cells(u, v)
        top = np.full((row.max() + 2, column.max() + 2), -1e9, np.float32)
        np.maximum.at(top, (row, column), height)
        self._top = cv2.dilate(top, np.ones((3, 3), np.uint8))

    def _is_lit(self, world: Array) -> Array:
        """Return which points (H, W, 3) the sun reaches."""
        u, v, height = np.moveaxis(world @ self._axes.T, -1, 0)
        row, column = self._cells(u, v)
        row, column = np.clip(row, 0, self._top.shape[0] - 1), np.clip(column, 0, self._top.shape[1] - 1)
        return height > self._top[row, column] - BIAS_M

    def _cells(self, u: Array, v: Array) -> NDArray[np.int_]:
        """Return row and column of places across the direction of the sun."""
        return (np.stack([v - self._corner[1], u - self._corner[0]]) / CELL_M).astype(int)


@dataclass(frozen=True)
class Placed:
    """What `localize` made of a drive."""

    num_images: int
    placed: int  # with a pose: TRACKING and DEGRADED
    num_wrong: int
    median_mm: float

    def __str__(self) -> str:
        return f"{self.placed} of {self.num_images}, {self.num_wrong} wrong, {self.median_mm:.1f} mm"


Result = tuple[Placed, Placed, Placed, Placed, Placed]  # alone, after, in its own map; first light before and after


class Room:
    """A recorded room in several lights, and what the commands make of it in a folder."""

    def __init__(self, recording: Recording, folder: Path, num_frames: int) -> None:
        self.folder = folder
        self._recording, self._num_frames = recording, num_frames

    def compare(self, kind: str, share: float, seed: int, day: Placed) -> tuple[Result, str]:
        """Localise before and after one extension, and in a map of the light alone; return what was said of it, too."""
        name = f"{kind}{round(100 * share)}"
        joined, driven = self.drives(name, self.light(kind, share, seed))
        alone = self.localize("map_day", driven)
        self.map(joined, f"map_{name}_own")
        own = self.localize(f"map_{name}_own", driven)
        try:
            said = self.map(joined, f"map_{name}", "--extend", self.folder / "map_day", "--experience", name)
        except ValueError:
            return (alone, Placed(own.num_images, 0, 0, np.nan), own, day, day), "refused"
        after, first = (self.localize(f"map_{name}", one) for one in (driven, "day_2"))
        told = next((line for line in said.splitlines() if line.startswith("joined")), "")
        return (alone, after, own, day, first), told

    def map(self, drive: str, name: str, *words: Any) -> str:
        """Make a map; return what was said."""
        return call("map", self.folder / drive, "-o", self.folder / name, *(words or ("--anchor", "truth")))

    def localize(self, name: str, drive: str, *words: str) -> Placed:
        """Localise a drive, judged by its truth; more words for the command."""
        poses, summary = self.folder / "poses.tum", self.folder / "summary.json"
        given = "localize", self.folder / name, self.folder / drive, "-o", poses, "--json", summary, "--overwrite"
        with suppress(ValueError):  # no image was placed, which the summary says
            call(*given, *words)
        found = json.loads(summary.read_text(encoding="utf-8"))
        placed = sum(found["states"].get(state, 0) for state in ("TRACKING", "DEGRADED"))
        if not found["poses"]:
            return Placed(found["images"], placed, 0, np.nan)
        errors = evaluate_poses(read_tum(poses), read_poses(self.folder / drive, TRUTH)).errors
        is_wrong = (errors.translation_m > WRONG[0]) | (np.degrees(errors.rotation_rad) > WRONG[1])
        return Placed(found["images"], placed, int(is_wrong.sum()), 1e3 * float(np.median(errors.translation_m)))

    def base(self) -> Placed:
        """Map the first drive in its own light, localise the third one in it."""
        for number in (0, 2):
            self.drive("day", None, number)
        self.map("day_0", "map_day")
        return self.localize("map_day", "day_2")

    def drives(self, name: str, light: Light) -> tuple[str, str]:
        """Make the bags of the second and of the third drive; return their names."""
        return self.drive(name, light, 1), self.drive(name, light, 2)

    def light(self, kind: str, share: float, seed: int, what: type[Light] = Light) -> Light:
        """Return another light of this room."""
        frames = [self._recording.frame(path) for path in self._paths(0)[::5]]
        return what(kind, share, seed, frames)

    def _paths(self, number: int) -> list[Path]:
        return [self._recording.poses / f"frame-{i:06d}.pose.txt" for i in range(number, self._num_frames, STEP)]

    def drive(self, name: str, light: Any, number: int) -> str:
        """Make a bag of a drive in a light; return its name."""
        bag, folder = self.folder / f"{name}_{number}", self.folder / f"{name}_{number}_images"
        folder.mkdir()
        for path in self._paths(number):
            frame = self._recording.frame(path)
            gray = frame.gray.astype(np.float32)
            gray = gray if light is None else light.shine(gray, frame.depth_m, frame.T_world_camera)
            cv2.imwrite(str(folder / f"{frame.name}.color.png"), np.clip(np.rint(gray), 1, 255).astype(np.uint8))
            for source in (self._recording.folder / f"{frame.name}.depth.png", path):
                shutil.copy(source, folder / source.name)
        call("import", "seven_scenes", folder, "-o", bag, "--truth-camera", "colour")
        return bag.name


def in_kitchen(options: argparse.Namespace, report: Report, measure: Callable[[Room], None]) -> Report:
    """Measure in the recorded room, in a part of it where the size is quick; return the report."""
    recording = Recording.open(options.data)
    if recording is None:
        return Report(report.name, skipped=f"no redkitchen with COLMAP's poses in {options.data}")
    measure(Room(recording, options.folder, NUM_FRAMES[options.size]))
    return report


def run(options: argparse.Namespace) -> Report:
    """Measure every light."""
    report, found, rows = Report("relight", notes=[__doc__ or ""]), list[Result](), list[tuple[str, ...]]()

    def measure(room: Room) -> None:
        day = room.base()
        for seed, (kind, share) in enumerate(LIGHTS[:1] if options.size == "quick" else LIGHTS, options.seed):
            result, said = room.compare(kind, share, seed, day)
            found.append(result)
            alone, *others = map(str, result)
            rows.append((f"{kind} {share:.0%}, seed {seed}", alone, said, *others))
        report.tables.append(Table(TITLE, COLUMNS, rows))
        report.bounds += judge("redkitchen", found)

    return in_kitchen(options, report, measure)


def judge(what: str, found: list[Result]) -> list[Bound]:
    """Return the bounds over all lights of a place."""
    first = [100.0 * alone.placed / own.placed for alone, _, own, _, _ in found]
    extended = [100.0 * after.placed / own.placed for _, after, own, _, _ in found]
    worse = max(after.median_mm / own.median_mm for _, after, own, _, _ in found)
    wrong = sum(alone.num_wrong + after.num_wrong + day_after.num_wrong for alone, after, _, _, day_after in found)
    lost = sum(max(0, day.placed - day_after.placed) for *_, day, day_after in found)
    blur = max(day_after.median_mm / day.median_mm for *_, day, day_after in found)
    of = Headline("other light", f"{what} in {len(found)} lights", "a map of that light alone: 100 %")
    return [
        Bound(f"{what}: placed on the first visit, {OF_OWN}", 90.0, float(np.mean(first)), "%", True, of),
        Bound(f"{what}: placed after one extension, all lights", 99.0, float(np.mean(extended)), "%", True, of),
        Bound(f"{what}: placed after one extension, worst light", 99.0, min(extended), "%", True, of),
        Bound(f"{what}: wrong, all drives", 0, wrong, ""),
        Bound(f"{what}: median error after it over that in the own map, worst", MAX_WORSE, worse, ""),
        Bound(f"{what}: images of the first light lost by it", 0, lost, ""),
        Bound(f"{what}: its median error over that before, worst", 1.1, blur, ""),
    ]
