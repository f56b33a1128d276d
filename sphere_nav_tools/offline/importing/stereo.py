"""Stereo recordings: KITTI odometry (rectified), and raw ones of several days, EuRoC, TUM-VI (ASL folders), 4Seasons.

Cameras that are not rectified have lenses and poses of their own, told by `camera_info` and `/tf_static`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pyproj import Transformer
from scipy.spatial.transform import Rotation

from sphere_nav.geometry import SE3, Camera, Fisheye, Pinhole
from sphere_nav.geometry.arrays import Array, Size
from sphere_nav.geometry.files.foreign_rig import load_foreign
from sphere_nav.geometry.files.untrusted import choice, number, read_as, read_text, required, told_at
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav_tools.offline.constants import DEFAULT_HZ, MAX_PAIR_GAP_NS
from sphere_nav_tools.offline.importing.files import (
    Matrix,
    pose_of_matrix,
    pose_of_row,
    read_image,
    read_numbers,
    read_pose,
    read_stamped,
    read_words,
    require_folder,
    trajectory,
    whole,
)
from sphere_nav_tools.offline.importing.recording import (
    FIRST_STAMP_NS,
    Recording,
    camera_recording,
    listed,
    of_folder,
    pair_views,
    with_truth,
)

FOLDERS = {
    ("image_0", "image_1"): (0, 1),
    ("image_l", "image_r"): (0, 1),
    ("image_2", "image_3"): (2, 3),
}  # of KITTI, with their P of calib.txt
TRUTHS = ("state_groundtruth_estimate0", "mocap0", "vicon0")  # of an ASL folder, the best first
MODELS: dict[str, type[Pinhole] | type[Fisheye]] = {"radial-tangential": Pinhole, "equidistant": Fisheye}
MAX_TRUTH_GAP_NS = 500_000_000  # between two true poses with an image between them; 4Seasons gives key frames alone
# 4Seasons was recorded around Munich; its truth is about the Earth's center. One frame for all of it: east, north, up
# at 48.14 deg north, 11.58 deg east, 520 m above the ellipsoid (WGS 84); upright within 0.5 deg 50 km around
MUNICH = (48.14, 11.58, 520.0)


@dataclass(frozen=True)
class _AslCamera:
    T_BS: Matrix
    resolution: Size
    intrinsics: tuple[float, float, float, float]
    distortion_model: str
    distortion_coefficients: tuple[float, float, float, float]


def open_kitti(folder: Path) -> Recording:
    """Open a sequence: calib.txt, two folders of images, and times.txt and poses.txt where they are there."""
    require_folder(folder)
    names = next((names for names in FOLDERS if (folder / names[0]).is_dir()), next(iter(FOLDERS)))
    folders = [require_folder(folder / name) for name in names]
    images = sorted(folders[0].glob("*.png"))
    if not images:
        raise ValueError(f"{folders[0]}: expected images 000000.png and on, found none")
    P_left, P_right = (_projection(folder / "calib.txt", index) for index in FOLDERS[names])
    height, width = read_image(images[0]).shape[:2]
    camera = Pinhole(width, height, P_left[0, 0], P_left[1, 1], P_left[0, 2], P_left[1, 2])
    baseline = (P_left[0, 3] - P_right[0, 3]) / P_left[0, 0]
    if not baseline > 0:
        raise ValueError(f"{folder / 'calib.txt'}: expected the second camera to the right, found {baseline} m")
    rows = [whole(path.stem, str(path)) for path in images]
    times, poses = (_optional(folder / name, n, rows) for name, n in (("times.txt", 1), ("poses.txt", 12)))
    seconds = np.array(rows) / DEFAULT_HZ if times is None else times[:, 0]
    stamps = [FIRST_STAMP_NS + round(float(second) * 1e9) for second in seconds]
    pair = [listed((stamp, at / path.name) for stamp, path in zip(stamps, images, strict=True)) for at in folders]
    views = pair_views(pair, (camera, camera), SE3.from_parts(np.eye(3), [baseline, 0.0, 0.0]), baseline)
    recording = camera_recording(views, max_gap_ns=MAX_PAIR_GAP_NS)
    if poses is None:
        return recording
    matrices = np.concatenate([poses, np.tile((0.0, 0.0, 0.0, 1.0), (len(poses), 1))], axis=1)
    T_ahead_left = pose_of_matrix(matrices, folder / "poses.txt")  # in a world whose z points ahead
    truth = trajectory(np.array(stamps), T_BODY_OPTICAL @ T_ahead_left, folder / "times.txt")
    return with_truth(recording, "poses.txt", truth)


def open_euroc(folder: Path) -> Recording:
    """Open an ASL folder: mav0/cam0, cam1 with data.csv and sensor.yaml, and a folder of truth where there is one."""
    require_folder(folder)
    mav = folder / "mav0" if (folder / "mav0").is_dir() else folder
    (left, T_body_left), (right, T_body_right) = (_asl_camera(mav / name / "sensor.yaml") for name in ("cam0", "cam1"))
    source = next((mav / name / "data.csv" for name in TRUTHS if (mav / name / "data.csv").is_file()), None)
    truth = None if source is None else _asl_truth(source, T_body_left)
    name = "" if source is None else source.parent.name
    folders = mav / "cam0" / "data", mav / "cam1" / "data"
    return _stereo(folders, (left, right), T_body_left.inverse() @ T_body_right, truth, name)


def open_four_seasons(folder: Path) -> Recording:
    """Open undistorted_images/cam0, cam1 named by their stamps, the set's folder calibration, and GNSSPoses.txt."""
    require_folder(folder)
    calibration = next((p / "calibration" for p in (folder, folder.parent) if (p / "calibration").is_dir()), None)
    if calibration is None:
        raise ValueError(f"{folder.parent / 'calibration'}: expected that of 4Seasons, found none")
    lenses = [_undistorted(calibration / f"undistorted_calib_{number}.txt") for number in (0, 1)]
    T_left_right = read_pose(calibration / "undistorted_calib_stereo.txt")
    truth = _gnss_poses(folder) if (folder / "GNSSPoses.txt").is_file() else None
    folders = folder / "undistorted_images" / "cam0", folder / "undistorted_images" / "cam1"
    return _stereo(folders, lenses, T_left_right, truth, "GNSSPoses.txt")


def _stereo(
    folders: Sequence[Path], lenses: Sequence[Camera], T_left_right: SE3, truth: Trajectory | None, name: str
) -> Recording:
    """Return a recording of pairs named by their stamps; the truth is that of the left camera's optical frame."""
    pair = [of_folder(require_folder(at), is_stamped=True) for at in folders]
    recording = camera_recording(pair_views(pair, lenses, T_left_right), max_gap_ns=MAX_PAIR_GAP_NS)
    return with_truth(recording, name, truth, MAX_TRUTH_GAP_NS)


def _projection(path: Path, index: int) -> Array:
    """Return P<index> (3, 4) from the line 'P<index>: ...', or the line of that number where they carry no names."""
    rows = [words for _, words in read_words(path)]
    named = {words[0].rstrip(":"): words[1:] for words in rows if words[0].startswith("P")}
    words = named.get(f"P{index}", []) if named else [*rows, *[[]] * (index + 1)][index]
    if len(words) != 12:
        raise ValueError(f"{path}: P{index}: expected 12 numbers, found {len(words)}")
    return np.array([number(word, f"{path}: P{index}") for word in words]).reshape(3, 4)


def _optional(path: Path, columns: int, rows: list[int]) -> Array | None:
    """Return some rows of a table, None where it is not there."""
    if not path.is_file():
        return None
    table = read_numbers(path, columns)
    if len(table) <= max(rows):
        raise ValueError(f"{path}: expected at least {max(rows) + 1} rows (image {max(rows):06d}), found {len(table)}")
    return table[rows]


def _asl_camera(path: Path) -> tuple[Camera, SE3]:
    """Return the camera of a sensor.yaml and its pose T_body_camera, optical axes."""
    found: _AslCamera = read_as(_AslCamera, load_foreign(path), str(path))
    model = MODELS[choice(found.distortion_model, f"{path}: distortion_model", MODELS)]
    with told_at(path):
        camera = model(*found.resolution, *found.intrinsics, found.distortion_coefficients)
    return camera, pose_of_matrix(found.T_BS.data, path)


def _asl_truth(path: Path, T_body_left: SE3) -> Trajectory:
    """Return the true poses of the left camera by those of the body: stamp in ns, x y z, qw qx qy qz, ..."""
    stamps, rows = read_stamped(path, 7)
    is_seen = rows[:, 3:].any(axis=1)  # not where the target was out of sight
    rows = np.concatenate([rows[:, :3], np.roll(rows[:, 3:], -1, axis=1)], axis=1)[is_seen]
    return trajectory(stamps[is_seen], pose_of_row(rows, path) @ T_body_left, path)


def _undistorted(path: Path) -> Pinhole:
    """Return the camera of lines 'Pinhole fx fy cx cy 0 0 0 0' and 'width height'."""
    rows = read_words(path, 1)
    if len(rows) < 2 or rows[0][1][0] != "Pinhole" or len(rows[0][1]) < 5 or len(rows[1][1]) != 2:
        raise ValueError(f"{path}: expected 'Pinhole fx fy cx cy ...' and 'width height', found others")
    width, height, fx, fy, cx, cy = (number(word, str(path)) for word in (*rows[1][1], *rows[0][1][1:5]))
    return Pinhole(int(width), int(height), fx, fy, cx, cy)


def _gnss_poses(folder: Path) -> Trajectory:
    """Return the true poses of the left camera in one frame for the whole set, from its key frames.

    T_e_gpsw inv(T_w_gpsw) T_S_AS takes what is scaled by the last number of a pose to the Earth's frame.
    """
    path = folder / "Transformations.txt"
    named, name = {}, ""
    for line in read_text(path, "transformations of 4Seasons").split("\n"):
        if line.startswith("#"):
            name = line[1:].split(":")[0].strip()
        elif line.count(",") == 6:
            named[name] = pose_of_row(np.array([number(word, f"{path}: {name}") for word in line.split(",")]), path)
    needed = required(named, str(path), ("transform_e_gpsw", "transform_w_gpsw", "transform_S_AS"))
    position = Transformer.from_crs("EPSG:4979", "EPSG:4978").transform(*MUNICH)  # degrees to m about the center
    axes = Rotation.from_euler("ZX", [90.0 + MUNICH[1], 90.0 - MUNICH[0]], degrees=True).as_matrix()
    T_munich_earth = SE3.from_parts(axes, np.array(position)).inverse()
    T_map_visual = T_munich_earth @ needed["transform_e_gpsw"] @ needed["transform_w_gpsw"].inverse()
    T_map_slam = T_map_visual @ needed["transform_S_AS"]
    path = folder / "GNSSPoses.txt"
    stamps, rows = read_stamped(path, 8)
    poses = pose_of_row(rows[:, :7], path)
    return trajectory(stamps, T_map_slam @ SE3.from_parts(poses.rotation, rows[:, 7:] * poses.translation), path)
