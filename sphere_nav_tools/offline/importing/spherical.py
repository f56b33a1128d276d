"""Omnidirectional RGB-D: a ring of sensors (rgbd360) stitched into spheres, or equirectangular images with range."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from sphere_nav_msgs.msg import AugmentedSphere

from sphere_mapping.acquisition.params import StitchParams
from sphere_mapping.acquisition.partial.window import full_width_for
from sphere_mapping.acquisition.stitching.stitcher import Stitcher
from sphere_nav.geometry import SE3, Pinhole, Rig, RigCamera, Spherical
from sphere_nav.geometry.trajectory import Trajectory, read_tum
from sphere_nav.params import build
from sphere_nav.ros.conversions import sphere_to_message
from sphere_nav.spheres.sphere import Sphere
from sphere_nav_tools.offline.evaluation import trajectory_of
from sphere_nav_tools.offline.importing.files import (
    read_meters,
    read_pose,
    read_rgb,
    require_folder,
    require_size,
)
from sphere_nav_tools.offline.importing.frames import even_stamps, order_of
from sphere_nav_tools.offline.importing.recording import Instant, Recording, with_truth

SPHERE_FRAME = "sphere_link"
NUM_SENSORS = 8
SENSOR = Pinhole(320, 240, 262.5, 262.5, 159.5, 119.5)  # every Xtion of the ring
# Body axes (x forward, y left, z up) from those of the ring: its x points up, its z along the first sensor.
T_BODY_RIG = SE3(np.array([[0.0, 0, 1, 0], [0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 0, 1]]))


def sphere_recording(stamps: Sequence[int], sphere: Callable[[int, int], Sphere]) -> Recording:
    """Return spheres on the topic `sphere`; `sphere(index, stamp)` makes one when it is needed."""

    def make(index: int, stamp: int) -> AugmentedSphere:
        return sphere_to_message(sphere(index, stamp), SPHERE_FRAME)

    instants = [Instant(stamp, others={"sphere": partial(make, index, stamp)}) for index, stamp in enumerate(stamps)]
    return Recording({}, instants, link=SPHERE_FRAME)


def open_spherical(folder: Path) -> Recording:
    """Open either layout, whichever is there; spheres are one second apart."""
    if any(require_folder(folder).glob("image_*.*")):
        return _open_equirectangular(folder)
    if not any(folder.glob("sphere_*")):
        raise ValueError(f"{folder}: expected folders sphere_* with Extrinsics, or files image_*.png, found neither")
    return _open_ring(folder)


def _open_ring(folder: Path) -> Recording:
    """Open sphere_*/rgb_k.png, depth_k.png (mm, registered) of eight sensors, Extrinsics/Rt_0k.txt, gicp_T_*_*.txt."""
    names = sorted(folder.glob("sphere_*"), key=order_of)
    poses = {
        f"rgb_{k}": T_BODY_RIG @ read_pose(folder / "Extrinsics" / f"Rt_0{k}.txt") for k in range(1, NUM_SENSORS + 1)
    }
    settings = {"width": 2 * full_width_for(SENSOR.pixels_per_radian / 2), "range": "none", "fusion.max_depth_m": 100.0}
    rig = Rig(tuple(RigCamera(name, SENSOR, T) for name, T in poses.items()))
    stitcher = Stitcher(rig, build(StitchParams, settings))

    def sphere(index: int, stamp: int) -> Sphere:
        depths = {name: read_meters(names[index] / f"{name.replace('rgb', 'depth')}.png") for name in poses}
        images = {name: read_rgb(names[index] / f"{name}.png") for name in poses}
        return stitcher.stitch(images, stamp, depths=depths)

    known, file = _gicp_poses(folder, names)
    T_rig_sphere = stitcher.T_rig_sphere
    truth = known and known.moved(T_rig_sphere.inverse())
    return with_truth(sphere_recording(even_stamps(len(names), 1.0), sphere), file, truth, T_pose_link=T_rig_sphere)


def _gicp_poses(folder: Path, names: list[Path]) -> tuple[Trajectory | None, str]:
    """Return the poses of two spheres from gicp_T_<first>_<second>.txt, relative to the first."""
    plain = [name.name.replace("_", "") for name in names]
    for path in sorted(folder.glob("gicp_T_*_*.txt")):
        first, _, second = path.stem.removeprefix("gicp_T_").partition("_")
        if first in plain and second in plain:
            poses = {first: SE3.identity(), second: T_BODY_RIG @ read_pose(path) @ T_BODY_RIG.inverse()}
            stamps = dict(zip(plain, even_stamps(len(names), 1.0), strict=True))
            told = [(stamps[name], poses[name]) for name in plain if name in poses]
            return trajectory_of(*zip(*told, strict=True)), path.name
    return None, ""


def _open_equirectangular(folder: Path) -> Recording:
    """Open image_*.png|jpg (2 H x H) with range_*.png: range along the ray in mm, 0 unknown, 65535 far; poses.tum."""
    names = sorted((*folder.glob("image_*.png"), *folder.glob("image_*.jpg")), key=order_of)

    def sphere(index: int, stamp: int) -> Sphere:
        image = read_rgb(names[index])
        file = names[index].with_name(names[index].stem.replace("image_", "range_", 1) + ".png")
        range_m = read_meters(file, far=np.inf)
        camera = Spherical(image.shape[1], image.shape[0])
        require_size(file, range_m, camera)
        return Sphere(image, range_m, camera, stamp)

    recording, truth = sphere_recording(even_stamps(len(names), 1.0), sphere), folder / "poses.tum"
    if not truth.is_file():
        return recording
    told = read_tum(truth)
    if len(told) != len(names):
        raise ValueError(f"{truth}: expected {len(names)} rows, one an image, found {len(told)}")
    told = replace(told, stamps_ns=np.array(even_stamps(len(names), 1.0)))
    return with_truth(recording, truth.name, told, T_pose_link=SE3.identity())
