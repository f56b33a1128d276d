"""`street`: a kilometre at the speed of traffic, mapped by a stereo pair, driven again by one camera (M15 6.3.4)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from matplotlib import pyplot as plt
from tqdm import tqdm

from benchmarks.papers.result import JudgedFigure, write_result
from cycab_sim.params import SimParams
from cycab_sim.simulator import Simulator
from cycab_sim.vehicle import VehicleCommand
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.files.untrusted import load_yaml, read_text
from sphere_nav.geometry.trajectory import Trajectory, read_tum, write_tum
from sphere_nav.params import build
from sphere_nav.ros.bags import BagWriter
from sphere_nav.ros.conversions import array_to_image, camera_to_info, se3_to_transform
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav_tools.cli.demo.demo import BUSY, OTHER_DAY, new_folder
from sphere_nav_tools.cli.demo.plots import save_figure
from sphere_nav_tools.cli.import_ import write_frames
from sphere_nav_tools.offline.importing.recording import BASE_FRAME, OPTICAL_FRAME, camera_transforms

SPEED, PERIOD_NS = 13.9, 100_000_000  # m/s (50 km/h) and ns from image to image
CAMERA = Pinhole(640, 480, 450.0, 450.0, 319.5, 239.5)  # of the pair
BASELINE, MOUNTING = 0.54, (1.0, 0.0, 1.65)  # m
BESIDE, AHEAD = 0.3, 0.6  # of the second drive: to the left of the first one, and between its images, m
NOISE, SHAKE = 2.0, np.radians(0.25)  # of a grey level; of roll and pitch from image to image, rad
PLACED, NEAR = 99.0, 0.1  # %, m: of the second drive
LEFT_FRAME, RIGHT_FRAME = "left_optical", "right_optical"
WORLD: Mapping[str, Any] = {
    "world": "road",
    "rig.kind": "none",
    "sphere.width": 0,
    "camera.size": "640,480",
    "camera.mounting_deg": "1,0,1.65,0,0,0",
    "render.shadow_texel": 0.25,
    "traffic.density": "usual",
}


class RoadDrive:
    """A drive along the road at speed, instant by instant, as a recording that can be written into a bag."""

    truth_name = ""
    beside, ahead = 0.0, 0.0  # m

    def __init__(self, seed: int, more: Mapping[str, Any], reach: float) -> None:
        """`more`: parameters of the simulator; `reach`: m of the road that are driven."""
        self.simulator = Simulator(build(SimParams, {**WORLD, "seed": seed, **more}))
        self.rng = np.random.default_rng([seed, 41])
        length = min(reach, self.simulator.path.length)
        self.num_frames = int(length / (SPEED * PERIOD_NS * 1e-9))
        self.poses: list[SE3] = []  # T_world_base of each frame drawn

    def stamp_ns(self, index: int) -> int:
        """Return the stamp of an instant."""
        return (index + 11) * PERIOD_NS  # the simulator begins at 1 s

    def drive_to(self, index: int) -> None:
        """Put the car where it is at an instant; time passes."""
        simulator = self.simulator
        x, y, yaw, _ = simulator.path.at(index * SPEED * PERIOD_NS * 1e-9 + self.ahead).tolist()
        simulator.step(VehicleCommand(), self.stamp_ns(index) - simulator.time_ns)
        simulator.teleport(x - self.beside * np.sin(yaw), y + self.beside * np.cos(yaw), yaw)

    @property
    def trajectory(self) -> Trajectory:
        """Return where the car truly was."""
        stamps = np.array([self.stamp_ns(index) for index in range(len(self.poses))], dtype=np.int64)
        return Trajectory(stamps, SE3(np.array([pose.matrix for pose in self.poses])))


class StereoDrive(RoadDrive):
    """Rectified grey pairs of a car that pitches and rolls on its springs."""

    def static_transforms(self, stamp: int) -> list[TransformStamped]:
        """Return base_link -> camera_link -> left_optical, right_optical."""
        T_camera_right = T_BODY_OPTICAL @ SE3.from_parts(np.eye(3), [BASELINE, 0.0, 0.0])
        frames = {LEFT_FRAME: T_BODY_OPTICAL, RIGHT_FRAME: T_camera_right}
        return camera_transforms(stamp, frames, SE3.from_parts(np.eye(3), list(MOUNTING)))

    def frame(self, index: int) -> Iterator[tuple[str, Any]]:
        """Yield both images with their camera_info."""
        self.drive_to(index)
        shake = SE3.exp([0.0, 0.0, 0.0, *self.rng.normal(0.0, SHAKE, 2), 0.0])
        T_world_base = self.simulator.T_world_base @ shake
        self.poses.append(T_world_base)
        T_world_left = T_world_base @ SE3.from_parts(np.eye(3), list(MOUNTING)) @ T_BODY_OPTICAL
        stamp = self.stamp_ns(index)
        for side, frame_id, x in (("left", LEFT_FRAME, 0.0), ("right", RIGHT_FRAME, BASELINE)):
            image, _ = self.simulator.render(CAMERA, T_world_left @ SE3.from_parts(np.eye(3), [x, 0.0, 0.0]), True)
            noisy = np.clip(np.rint(image + self.rng.normal(0.0, NOISE, image.shape)), 0, 255).astype(np.uint8)
            yield f"{side}/camera_info", camera_to_info(CAMERA, stamp, frame_id, baseline=x)
            yield f"{side}/image_raw", array_to_image(noisy, stamp, frame_id, "mono8")


class MonoDrive(RoadDrive):
    """Images of the car's own camera: another lens, noise, an exposure that follows the light."""

    beside, ahead = BESIDE, AHEAD

    def static_transforms(self, stamp: int) -> list[TransformStamped]:
        """Return base_link -> camera_optical."""
        return [se3_to_transform(self.simulator.mounts["camera"].T_base_camera, stamp, BASE_FRAME, OPTICAL_FRAME)]

    def frame(self, index: int) -> Iterator[tuple[str, Any]]:
        """Yield the image with its camera_info."""
        self.drive_to(index)
        self.poses.append(self.simulator.T_world_base)
        seen, stamp = self.simulator.capture("camera"), self.stamp_ns(index)
        encoding = "mono8" if seen.image.ndim == 2 else "rgb8"
        yield "camera_info", camera_to_info(seen.camera, stamp, OPTICAL_FRAME)
        yield "image_raw", array_to_image(seen.image, stamp, OPTICAL_FRAME, encoding)


class Street:
    """Map by the pair, drive again by one camera, through the commands that a user types."""

    purpose = "1 km at 50 km/h by a stereo pair; a second drive in traffic by one camera (M15 6.3.4); no messages"
    reach = np.inf  # m

    def __init__(self, name: str, output: Path, seed: int) -> None:
        self.name, self.seed, self.folder = name, seed, new_folder(output)

    def run(self) -> bool:
        """Record, map, record, localise; judge."""
        taught = self.record(StereoDrive(self.seed, {}, self.reach), "teach")
        self.command("map", "teach", "-o", "map", "--taught", "taught.tum")
        again = self.record(MonoDrive(self.seed, {**BUSY, **OTHER_DAY}, self.reach), "drive")
        begin = read_tum(self.folder / "taught.tum").T_map_body[0]
        pose = ",".join(f"{value:.6f}" for value in (*begin.translation, *begin.quaternion))
        self.command("localize", "map", "drive", "-o", "drive.tum", "--json", "drive.json", f"--initial-pose={pose}")
        return self.judge(taught, again)

    def record(self, drive: RoadDrive, name: str) -> Trajectory:
        """Write the bag of a drive and where the car truly was."""
        with BagWriter(self.folder / name) as bag:
            write_frames(bag, drive, tqdm(range(drive.num_frames), unit="frame", desc=name, disable=None))  # type: ignore[arg-type]
        write_tum(self.folder / f"{name}_truth.tum", drive.trajectory)
        return drive.trajectory

    def command(self, *words: str) -> None:
        """Run a command on files of the folder; RuntimeError if it fails."""
        from sphere_nav_tools.cli.main import main

        names = ("teach", "map", "drive", "taught.tum", "drive.tum", "drive.json")
        if main([words[0], *(str(self.folder / word) if word in names else word for word in words[1:])]):
            raise RuntimeError(f"{words[0]}: failed")

    def judge(self, taught: Trajectory, again: Trajectory) -> bool:
        """Compare both drives with the truth, draw, write the result."""
        summary = self.folder / "drive.json"
        mapped, localized = read_tum(self.folder / "taught.tum"), read_tum(self.folder / "drive.tum")
        told = load_yaml(summary, read_text(summary, "summary of a localized drive"))
        drift = drift_percent(mapped, taught)
        meters = relative_errors_m(localized, again, mapped, taught)
        figure, axes = plt.subplots(figsize=(10, 5))
        axes.plot(again.distances[-1] * np.arange(len(meters)) / max(len(meters), 1), 100.0 * meters, color="tab:blue")
        axes.set(xlabel="way [m]", ylabel="error in the map [cm]", title="Second drive by one camera")
        axes.grid(alpha=0.3)
        save_figure(figure, self.folder / "errors.png")
        tracking = 100.0 * told["states"].get("TRACKING", 0) / told["images"]
        figures = [
            JudgedFigure("way", float(taught.distances[-1]), "m"),
            JudgedFigure("drift of the map at its end", drift, "%", 0.5),
            JudgedFigure("second drive: images in TRACKING", tracking, "%", PLACED, is_minimum=True),
            JudgedFigure("second drive: error in the map, median", float(np.median(meters)), "m"),
            JudgedFigure("second drive: error in the map, largest", float(meters.max()), "m", NEAR),
        ]
        return write_result(self.folder, self.name, self.seed, figures, {"localize": told})


def drift_percent(mapped: Trajectory, truth: Trajectory) -> float:
    """Return how far the end of a mapped drive is from where it truly was, seen from its beginning, % of the way."""
    at, known = truth.at(mapped.stamps_ns)
    ours, true = mapped[known].T_map_body, at.T_map_body
    off = (true[0].inverse() @ true[-1]).inverse() @ (ours[0].inverse() @ ours[-1])
    return 100.0 * float(np.linalg.norm(off.translation)) / float(truth.distances[-1])


def relative_errors_m(localized: Trajectory, truth: Trajectory, mapped: Trajectory, taught: Trajectory) -> Array:
    """Return how far each pose (N,) m is off, seen from the nearest place of the taught drive.

    That is what a car that follows the path in the map would be off: the drift of the map does not count.
    """
    at, known = truth.at(localized.stamps_ns)
    there, of_map = taught.at(mapped.stamps_ns)
    off = at.positions[:, None] - there.positions
    nearest = np.argmin(np.linalg.norm(off, axis=2), axis=1)
    ours = mapped[of_map].T_map_body[nearest].inverse() @ localized[known].T_map_body
    expected = there.T_map_body[nearest].inverse() @ at.T_map_body
    return np.asarray(np.linalg.norm(ours.translation - expected.translation, axis=1))
