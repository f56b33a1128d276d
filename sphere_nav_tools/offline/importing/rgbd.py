"""RGB-D recordings: Microsoft 7-Scenes, TUM, and of many days OpenLORIS and ROVER."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sphere_mapping.acquisition.partial.depth_registration import DepthRegistration
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.arrays import Floats
from sphere_nav.geometry.files.foreign_rig import load_foreign
from sphere_nav.geometry.files.untrusted import parse_stamp_ns, read_as, required
from sphere_nav.geometry.trajectory import Trajectory, read_tum
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav_tools.offline.constants import MAX_PAIR_GAP_NS
from sphere_nav_tools.offline.evaluation import trajectory_of
from sphere_nav_tools.offline.importing.files import (
    Matrix,
    pose_of_matrix,
    pose_of_row,
    read_meters,
    read_numbers,
    read_pose,
    read_words,
    require_folder,
    require_size,
    whole,
)
from sphere_nav_tools.offline.importing.recording import (
    FIRST_STAMP_NS,
    OPTICAL_FRAME,
    Recording,
    View,
    camera_recording,
    even_stamps,
    listed,
    with_truth,
)

KINECT_HZ = 30.0
D435 = "d400_color_optical_frame"  # of OpenLORIS: its colour camera, to which aligned_depth is registered
ROVER_FOLDERS = ("intelrealsense_D435i", "realsense_D435i", "d435i")
Listed = list[tuple[int, Path]]  # stamps and files


@dataclass(frozen=True)
class _Intrinsics:
    data: tuple[float, float, float, float]  # fx, cx, fy, cy


@dataclass(frozen=True)
class _Sensor:
    width: int
    height: int
    intrinsics: _Intrinsics
    distortion_coefficients: Matrix | None = None


@dataclass(frozen=True)
class _Frame:
    parent_frame: str
    child_frame: str
    matrix: Matrix


@dataclass(frozen=True)
class _Frames:
    trans_matrix: tuple[_Frame, ...]


def open_seven_scenes(
    folder: Path,
    camera: Pinhole,
    depth_camera: tuple[Pinhole, SE3],
    *,
    is_truth_of_depth: bool,
    poses: Path | None = None,
) -> Recording:
    """Open frame-%06d.{color.png|jpg, depth.png, pose.txt}; depth in mm, 0 and 65535 invalid; poses camera -> world.

    `depth_camera` is its lens and T_color_depth; `poses` a folder with other pose.txt than those beside the images.
    """
    depths = sorted(require_folder(folder).glob("frame-*.depth.png"))
    if not depths:
        raise ValueError(f"{folder}: expected files frame-000000.depth.png and on, found none")
    T_depth_color = depth_camera[1].inverse() if is_truth_of_depth else SE3.identity()
    colors, stamped, true_poses = Listed(), Listed(), list[SE3]()
    for depth in depths:
        name = depth.name.removesuffix(".depth.png")
        stamp = FIRST_STAMP_NS + round(whole(name.removeprefix("frame-"), str(depth)) * 1e9 / KINECT_HZ)
        color = next(folder.glob(f"{name}.color.*"), None)
        if color is None:
            raise ValueError(f"{folder / name}.color.png: expected a file (or .color.jpg), found none")
        colors.append((stamp, color))
        stamped.append((stamp, depth))
        true_poses.append(read_pose((poses or folder) / f"{name}.pose.txt") @ T_depth_color)
    register = DepthRegistration(depth_camera[0], camera, depth_camera[1])
    recording = _rgbd(colors, stamped, camera, 1000.0, register)
    truth = trajectory_of([stamp for stamp, _ in stamped], true_poses).moved(T_BODY_OPTICAL)  # z of its world is ahead
    return with_truth(recording, "frame-*.pose.txt", truth)


def open_tum(folder: Path, camera: Pinhole, depth_units: float) -> Recording:
    """Open rgb.txt, depth.txt and groundtruth.txt of the TUM benchmark, or a pair img_prev, dep_prev, pose_prev, ..."""
    require_folder(folder)
    if (folder / "img_prev.png").is_file():
        return _tum_pair(folder, camera, depth_units)
    recording = _rgbd(_read_list(folder / "rgb.txt"), _read_list(folder / "depth.txt"), camera, depth_units)
    truth = read_tum(folder / "groundtruth.txt") if (folder / "groundtruth.txt").exists() else None
    return with_truth(recording, "groundtruth.txt", truth, 2 * MAX_PAIR_GAP_NS)


def _tum_pair(folder: Path, camera: Pinhole, depth_units: float) -> Recording:
    stamps, names = even_stamps(2, KINECT_HZ), ("prev", "curr")
    files = ([folder / f"{kind}_{name}.png" for name in names] for kind in ("img", "dep"))
    colors, depths = ([*zip(stamps, found, strict=True)] for found in files)
    paths = [folder / f"pose_{name}.txt" for name in names]
    truth = trajectory_of(stamps, [pose_of_row(read_numbers(path, 7)[0], path) for path in paths])
    return with_truth(_rgbd(colors, depths, camera, depth_units), "pose_prev.txt, pose_curr.txt", truth)


def open_openloris(folder: Path) -> Recording:
    """Open color.txt, aligned_depth.txt (mm), sensors.yaml, trans_matrix.yaml and groundtruth.txt, of the base."""
    colors, depths = (_read_list(require_folder(folder) / name) for name in ("color.txt", "aligned_depth.txt"))
    path = folder / "sensors.yaml"
    found: _Sensor = read_as(_Sensor, required(load_foreign(path), str(path), [D435])[D435], f"{path}: {D435}")
    fx, cx, fy, cy = found.intrinsics.data
    distortion = found.distortion_coefficients.data if found.distortion_coefficients else ()
    camera = Pinhole(found.width, found.height, fx, fy, cx, cy, distortion)
    T_base_optical, truth = _mounting(folder / "trans_matrix.yaml"), None
    if (folder / "groundtruth.txt").is_file():
        base = read_tum(folder / "groundtruth.txt")
        truth = Trajectory(base.stamps_ns, base.T_map_body @ T_base_optical)
    recording = _rgbd(colors, depths, camera, 1000.0)
    recording = replace(recording, T_base_link=T_base_optical @ T_BODY_OPTICAL.inverse())
    return with_truth(recording, "groundtruth.txt", truth, 2 * MAX_PAIR_GAP_NS)


def open_rover(folder: Path, camera: Pinhole) -> Recording:
    """Open rgb and depth (mm, registered) of the D435i of ROVER, images named by their stamps in s.

    Its truth is the place of a prism on the vehicle, no pose of a camera: it is left out.
    """
    require_folder(folder)
    inner = next((folder / name for name in ROVER_FOLDERS if (folder / name / "rgb").is_dir()), folder)
    paths = (require_folder(inner / name).glob("*.png") for name in ("rgb", "depth"))
    colors, depths = (sorted((parse_stamp_ns(path.stem, f"{path}: name"), path) for path in found) for found in paths)
    return _rgbd(colors, depths, camera, 1000.0)


def _rgbd(
    colors: Listed,
    depths: Listed,
    camera: Pinhole,
    depth_units: float,
    register: Callable[[Any], Floats] = lambda depth: depth,
) -> Recording:
    """Return a recording of images, and depth that is registered to them."""

    def read_depth(path: Path) -> Floats:
        depth = read_meters(path, depth_units)
        require_size(path, depth, camera)  # of Kinects both have the same
        return register(depth)

    color = View("", OPTICAL_FRAME, camera, listed(colors))
    depth = View("depth/", OPTICAL_FRAME, camera, listed(depths, read_depth))
    return camera_recording({"color": color, "depth": depth}, max_gap_ns=MAX_PAIR_GAP_NS)


def _mounting(path: Path) -> SE3:
    """Return T_base_optical of the colour camera from a list of parent_frame, child_frame and matrix."""
    found: _Frames = read_as(_Frames, load_foreign(path), str(path))
    above, frame, T_frame_optical = {row.child_frame: row for row in found.trans_matrix}, D435, SE3.identity()
    while frame != "base_link":
        row = above.pop(frame, None)  # each once: a ring of frames ends, too
        if row is None:
            raise ValueError(f"{path}: expected a way from {D435} to base_link, found none from {frame}")
        T_frame_optical = pose_of_matrix(row.matrix.data, path) @ T_frame_optical
        frame = row.parent_frame
    return T_frame_optical


def _read_list(path: Path) -> list[tuple[int, Path]]:
    return [(parse_stamp_ns(words[0], where), path.parent / words[1]) for where, words in read_words(path, 2)]
