"""Plain images: of a rig, of one camera, of a stereo pair, panoramas, or pairs of these, one above the other.

Omnidirectional RGB-D, too: a ring of sensors (rgbd360) stitched into spheres, or equirectangular images with range.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from sphere_nav_msgs.msg import AugmentedSphere

from sphere_mapping.acquisition.params import MatchParams, StitchParams
from sphere_mapping.acquisition.partial.window import full_width_for
from sphere_mapping.acquisition.range.matching import match_columns
from sphere_mapping.acquisition.range.semi_global import check_order
from sphere_mapping.acquisition.range.vertical import disparities_of_ranges, range_from_disparity
from sphere_mapping.acquisition.stitching.stitcher import Stitcher
from sphere_nav.geometry import SE3, Pinhole, Rig, RigCamera, Spherical
from sphere_nav.geometry.arrays import Bytes
from sphere_nav.geometry.files.rig_file import read_rig
from sphere_nav.geometry.trajectory import Trajectory, read_tum
from sphere_nav.params import build
from sphere_nav.ros.conversions import sphere_to_message
from sphere_nav.spheres.sphere import Sphere
from sphere_nav_tools.offline.evaluation import BAG_SUFFIXES, trajectory_of
from sphere_nav_tools.offline.importing.files import (
    pinhole,
    read_meters,
    read_pose,
    read_rgb,
    require_folder,
    require_size,
    rgb_of,
)
from sphere_nav_tools.offline.importing.recording import (
    CAMERA_FRAME,
    OPTICAL_FRAME,
    RIG_FRAME,
    SIDES,
    VIDEOS,
    Instant,
    Picture,
    Recording,
    View,
    camera_recording,
    even_stamps,
    guess_format,
    instants_of,
    is_image,
    open_frames,
    order_of,
    pair_views,
    rig_views,
    with_truth,
)
from sphere_nav_tools.offline.topic_finder import ALONE

SPHERE_FRAME = "sphere_link"
NUM_SENSORS = 8
SENSOR = Pinhole(320, 240, 262.5, 262.5, 159.5, 119.5)  # every Xtion of the ring
# Body axes (x forward, y left, z up) from those of the ring: its x points up, its z along the first sensor.
T_BODY_RIG = SE3(np.array([[0.0, 0, 1, 0], [0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 0, 1]]))
LEVELS = ("top", "bottom")
OPTIONS = "--rig, --camera (one camera, with --baseline a rectified pair), --panorama or --baseline"


def open_images(
    folder: Path,
    rig: Path | None,
    lens: tuple[float, ...] | None,
    baseline_m: float | None,
    hz: float | None,
    *,
    is_panorama: bool = False,
) -> Recording:
    """Open what the options tell: a rig file, a lens (with a baseline: rectified left and right), or panoramas.

    Panoramas with a baseline are top and bottom; without, `is_panorama`, they are of one camera, to localise with.
    """
    if not folder.is_file():
        require_folder(folder)
    if rig is not None:
        return _rig_recording(folder, read_rig(rig), hz)
    if lens is not None and baseline_m is not None:
        pair = [open_frames(folder, side, hz) for side in SIDES]
        lenses = [pinhole(pair[0][0].read().shape[1::-1], lens)] * 2
        T_left_right = SE3.from_parts(np.eye(3), [baseline_m, 0.0, 0.0])
        return camera_recording(pair_views(pair, lenses, T_left_right, baseline_m))
    if lens is None and baseline_m is not None:
        return _panoramas(folder, baseline_m, hz)
    if lens is None and not is_panorama:
        raise ValueError(f"{folder}: images: expected one of {OPTIONS}")
    frames = open_frames(folder, "", hz)
    if lens is not None:
        return camera_recording({"": View("", OPTICAL_FRAME, pinhole(frames[0].read().shape[1::-1], lens), frames)})
    height, width = _read_panorama(frames[0]).shape[:2]
    return camera_recording({"": View("", CAMERA_FRAME, Spherical(width, height), frames)})


def how_to_import(path: Path) -> list[str]:
    """Return what a video, or a folder that is a data set or has images, is, and the command for it; else nothing."""
    if any(file.name.endswith((*BAG_SUFFIXES, "metadata.yaml")) for file in path.glob("*")):
        return []
    kind = guess_format(path) if path.is_dir() else ""
    words = f"  sphere_nav import {kind or 'images'} {shlex.quote(str(path))} -o {shlex.quote(path.stem)}_bag"
    if kind:
        return [f"{path}: a data set, {kind}; as a bag:", words]
    if path.suffix.lower() not in VIDEOS and not (path.is_dir() and any(map(is_image, path.iterdir()))):
        return []
    frames = open_frames(path, "")
    height, width = frames[0].read().shape[:2]
    what = f"{path}: {len(frames)} images of {width} x {height}; as a bag, to localise with:"
    lens = f"{words} --camera {width},{width},{(width - 1) / 2:g},{(height - 1) / 2:g}"
    guess = "  fx,fy,cx,cy in px are a guess by the size: give yours, or --rig rig.yaml (sphere_nav calibrate)"
    return [what, *([f"{words} --panorama"] if width == 2 * height else [lens, guess]), ALONE]


def _rig_recording(folder: Path, rig: Rig, hz: float | None) -> Recording:
    """Return images of a rig; one camera, and left and right, have topics of their own."""
    is_lone = len(rig.cameras) == 1
    rig = Rig((replace(rig.cameras[0], name="camera"),)) if is_lone else rig
    cameras = {name: open_frames(folder, "" if is_lone else name, hz) for name in rig.names}
    if not is_lone and rig.names != SIDES:
        return camera_recording(rig_views(rig, cameras), RIG_FRAME)
    return camera_recording(rig_views(rig, cameras, "" if is_lone else "{}/"))


def _panoramas(folder: Path, baseline_m: float, hz: float | None) -> Recording:
    """Open equirectangular pairs, 2 H x H: folders or videos top and bottom -> spheres with range."""
    cameras = {level: open_frames(folder, level, hz) for level in LEVELS}
    instants = [part for part in instants_of(cameras) if len(part) == len(LEVELS)]
    if not instants:
        raise ValueError(f"{folder}: expected pairs of one time in top and bottom, found none")

    def sphere(index: int, stamp: int) -> Sphere:
        pair = [_read_panorama(instants[index][level]) for level in LEVELS]
        require_size(instants[index]["bottom"].where, pair[1], Spherical(pair[0].shape[1], pair[0].shape[0]))
        return match_panoramas(pair[0], pair[1], baseline_m, stamp, is_first=index == 0)

    return sphere_recording([part["top"].stamp_ns for part in instants], sphere)


def match_panoramas(top: Bytes, bottom: Bytes, baseline_m: float, stamp: int, *, is_first: bool) -> Sphere:
    """Match a pair; range is that of the top centre. `is_first`: also check which of the two is above."""
    gray = [cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image for image in (top, bottom)]
    if is_first:
        check_order(gray[0].astype(np.uint8), gray[1].astype(np.uint8), LEVELS, is_whole=True)
    window, params = Spherical(top.shape[1], top.shape[0]), MatchParams()
    search = disparities_of_ranges(window, baseline_m, params)
    disparity = match_columns(gray[0], gray[1], search, params, np.ones(gray[0].shape, np.bool_), 1)
    range_m, std_m = range_from_disparity(disparity, baseline_m, params)
    return Sphere(np.maximum(rgb_of(top), 1), range_m, window, stamp, std_m)


def _read_panorama(picture: Picture) -> Bytes:
    """Return an image; ValueError for one that is no whole sphere."""
    image = picture.read()
    height, width = image.shape[:2]
    if width != 2 * height:
        found = f"found {width} x {height}: export it as equirectangular"
        raise ValueError(f"{picture.where}: expected 2 H x H pixels of a whole sphere, {found}")
    return image


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
