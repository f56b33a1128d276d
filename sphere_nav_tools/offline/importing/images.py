"""Plain images: of a rig, of one camera, of a stereo pair, panoramas, or pairs of these, one above the other."""

from __future__ import annotations

import shlex
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from sphere_mapping.acquisition.params import MatchParams
from sphere_mapping.acquisition.range.matching import match_columns
from sphere_mapping.acquisition.range.semi_global import check_order
from sphere_mapping.acquisition.range.vertical import disparities_of_ranges, range_from_disparity
from sphere_nav.geometry import SE3, Pinhole, Rig, Spherical
from sphere_nav.geometry.arrays import Bytes
from sphere_nav.geometry.files.rig_file import read_rig
from sphere_nav.spheres.sphere import Sphere
from sphere_nav_tools.offline.importing.files import require_folder, require_size
from sphere_nav_tools.offline.importing.frames import (
    VIDEOS,
    Picture,
    Pictures,
    guess_format,
    instants_of,
    is_image,
    open_frames,
)
from sphere_nav_tools.offline.importing.recording import (
    CAMERA_FRAME,
    OPTICAL_FRAME,
    RIG_FRAME,
    SIDES,
    Recording,
    View,
    camera_recording,
    pair_views,
    rig_views,
)
from sphere_nav_tools.offline.importing.spherical import sphere_recording
from sphere_nav_tools.offline.pose_bags import BAG_SUFFIXES
from sphere_nav_tools.offline.topic_finder import ALONE

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
        lenses = [_pinhole(pair[0], lens)] * 2
        T_left_right = SE3.from_parts(np.eye(3), [baseline_m, 0.0, 0.0])
        return camera_recording(pair_views(pair, lenses, T_left_right, baseline_m))
    if lens is not None:
        frames = open_frames(folder, "", hz)
        return camera_recording({"": View("", OPTICAL_FRAME, _pinhole(frames, lens), frames)})
    if baseline_m is not None:
        return _panoramas(folder, baseline_m, hz)
    if not is_panorama:
        raise ValueError(f"{folder}: images: expected one of {OPTIONS}")
    frames = open_frames(folder, "", hz)
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


def _pinhole(frames: Pictures, lens: tuple[float, ...]) -> Pinhole:
    """Return the camera of a lens fx, fy, cx, cy and distortion, of the size of the first image."""
    height, width = frames[0].read().shape[:2]
    fx, fy, cx, cy, *distortion = lens
    return Pinhole(width, height, fx, fy, cx, cy, tuple(distortion))


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
    image = cv2.cvtColor(top, cv2.COLOR_BGR2RGB).astype(np.uint8) if top.ndim == 3 else top
    return Sphere(np.maximum(image, 1), range_m, window, stamp, std_m)


def _read_panorama(picture: Picture) -> Bytes:
    """Return an image; ValueError for one that is no whole sphere."""
    image = picture.read()
    height, width = image.shape[:2]
    if width != 2 * height:
        found = f"found {width} x {height}: export it as equirectangular"
        raise ValueError(f"{picture.where}: expected 2 H x H pixels of a whole sphere, {found}")
    return image
