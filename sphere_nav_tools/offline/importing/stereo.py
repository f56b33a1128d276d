"""Raw stereo recordings of several days: EuRoC and TUM-VI (ASL folders), 4Seasons.

Both cameras have their own lens and pose; which is told by `camera_info` and `/tf_static`, not by a baseline.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mcl_depth.geometry.geodetic import place_on_earth
from sphere_nav.geometry import SE3, Camera, Fisheye, Pinhole
from sphere_nav.geometry.files.opencv_file import load_opencv
from sphere_nav.geometry.files.untrusted import number, numbers, read_text, required
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav_tools.offline.constants import MAX_PAIR_GAP_NS
from sphere_nav_tools.offline.importing.recording import (
    Instant,
    Recording,
    body_from_optical,
    image_shot,
    pair_views,
    pose_of_matrix,
    pose_of_row,
    poses_at,
    read_pose,
    read_rows,
    require_folder,
    trajectory,
)

TRUTHS = ("state_groundtruth_estimate0", "mocap0", "vicon0")  # of an ASL folder, the best first
MODELS: dict[str, type[Pinhole] | type[Fisheye]] = {"radial-tangential": Pinhole, "equidistant": Fisheye}
MAX_TRUTH_GAP_NS = 500_000_000  # between two true poses with an image between them; 4Seasons gives key frames alone
# 4Seasons was recorded around Munich; its truth is about the Earth's center. One frame for all of it: east, north, up
# at 48.14 deg north, 11.58 deg east, 520 m above the ellipsoid (WGS 84); upright within 0.5 deg 50 km around
MUNICH = (*np.radians([48.14, 11.58]), 520.0)


def open_euroc(folder: Path) -> Recording:
    """Open an ASL folder: mav0/cam0, cam1 with data.csv and sensor.yaml, and a folder of truth where there is one."""
    require_folder(folder)
    mav = folder / "mav0" if (folder / "mav0").is_dir() else folder
    (left, T_body_left), (right, T_body_right) = (_asl_camera(mav / name / "sensor.yaml") for name in ("cam0", "cam1"))
    images, others = (_asl_images(mav / name) for name in ("cam0", "cam1"))
    source = next((mav / name / "data.csv" for name in TRUTHS if (mav / name / "data.csv").is_file()), None)
    truth = None if source is None else _asl_truth(source, T_body_left)
    stamps = np.array(sorted(others), dtype=np.int64)
    pairs = []
    for stamp, image in images.items():
        other = int(stamps[np.argmin(np.abs(stamps - stamp))])
        if abs(other - stamp) <= MAX_PAIR_GAP_NS:
            pairs.append((stamp, image, others[other]))
    if not pairs:
        raise ValueError(f"{mav / 'cam1' / 'data.csv'}: expected stamps of cam0, found others")
    name = "" if source is None else source.parent.name
    return _stereo(pairs, (left, right), T_body_left.inverse() @ T_body_right, truth, name)


def open_four_seasons(folder: Path) -> Recording:
    """Open undistorted_images/cam0, cam1 with times.txt, the set's folder calibration, and GNSSPoses.txt."""
    require_folder(folder)
    calibration = next((p / "calibration" for p in (folder, folder.parent) if (p / "calibration").is_dir()), None)
    if calibration is None:
        raise ValueError(f"{folder.parent / 'calibration'}: expected that of 4Seasons, found none")
    left, right = (require_folder(folder / "undistorted_images" / name) for name in ("cam0", "cam1"))
    cameras = [_undistorted(calibration / f"undistorted_calib_{side}.txt") for side in (0, 1)]
    T_left_right = read_pose(calibration / "undistorted_calib_stereo.txt")
    truth = _gnss_poses(folder) if (folder / "GNSSPoses.txt").is_file() else None
    pairs = []
    for row in read_rows(folder / "times.txt"):
        name = row.replace(",", " ").split()[0]
        if not name.isdigit():
            raise ValueError(f"{folder / 'times.txt'}: expected a number as name of an image, found {name[:40]!r}")
        if (left / f"{name}.png").is_file() and (right / f"{name}.png").is_file():
            pairs.append((int(name), left / f"{name}.png", right / f"{name}.png"))
    if not pairs:
        raise ValueError(f"{left}: expected images named as in times.txt, found none")
    return _stereo(pairs, (cameras[0], cameras[1]), T_left_right, truth, "GNSSPoses.txt")


def _stereo(
    pairs: list[tuple[int, Path, Path]],
    cameras: tuple[Camera, Camera],
    T_left_right: SE3,
    truth: Trajectory | None,
    name: str,
) -> Recording:
    """Return a recording of pairs (stamp, left, right); the truth is that of the left camera's optical frame."""
    instants = []
    poses = poses_at(truth, [stamp for stamp, _, _ in pairs], MAX_TRUTH_GAP_NS)
    for (stamp, left, right), pose in zip(pairs, poses, strict=True):
        T_map_body = None if pose is None else body_from_optical(pose, is_world_optical=False)
        instants.append(
            Instant(stamp, {"left": image_shot(left, stamp), "right": image_shot(right, stamp)}, T_map_body)
        )
    return Recording(pair_views(*cameras, T_left_right), instants, name)


def _asl_camera(path: Path) -> tuple[Camera, SE3]:
    """Return the camera of a sensor.yaml and its pose T_body_camera, optical axes."""
    names = ("T_BS", "resolution", "intrinsics", "distortion_model", "distortion_coefficients")
    values = required(load_opencv(path), str(path), names)
    width, height = (round(value) for value in numbers(values["resolution"], f"{path}: resolution", 2))
    fx, fy, cx, cy = numbers(values["intrinsics"], f"{path}: intrinsics", 4)
    k1, k2, k3, k4 = numbers(values["distortion_coefficients"], f"{path}: distortion_coefficients", 4)
    if values["distortion_model"] not in MODELS:
        found = repr(values["distortion_model"])[:40]
        raise ValueError(f"{path}: distortion_model: expected {' or '.join(MODELS)}, found {found}")
    matrix = numbers(required(values["T_BS"], f"{path}: T_BS", ["data"])["data"], f"{path}: T_BS", 16)
    try:
        camera = MODELS[values["distortion_model"]](width, height, fx, fy, cx, cy, (k1, k2, k3, k4))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return camera, pose_of_matrix(matrix, path)


def _asl_images(folder: Path) -> dict[int, Path]:
    """Return the images of a camera by their stamps, ns."""
    rows = [row.split(",") for row in read_rows(folder / "data.csv")]
    if not rows or any(len(row) != 2 or not row[0].strip().isdigit() for row in rows):
        raise ValueError(f"{folder / 'data.csv'}: expected lines 'stamp in ns,file', found others")
    return {int(stamp): folder / "data" / name.strip() for stamp, name in rows}


def _asl_truth(path: Path, T_body_left: SE3) -> Trajectory:
    """Return the true poses of the left camera by those of the body: stamp in ns, x y z, qw qx qy qz, ..."""
    stamps, poses = [], []
    for stamp, (x, y, z, qw, qx, qy, qz) in _stamped_rows(path, 7):
        if not qw == qx == qy == qz == 0.0:  # as where the target was out of sight
            stamps.append(stamp)
            poses.append(pose_of_row(np.array([x, y, z, qx, qy, qz, qw]), path) @ T_body_left)
    return trajectory(stamps, poses, path)


def _stamped_rows(path: Path, count: int) -> list[tuple[int, list[float]]]:
    """Return a stamp in ns and so many numbers of each line, among more words."""
    rows = []
    for text in read_rows(path):
        stamp, *words = text.split(",")
        if len(words) < count or not stamp.strip().isdigit():
            raise ValueError(f"{path}: expected a stamp in ns and a pose of {count} numbers, found {text[:60]!r}")
        rows.append((int(stamp), [number(word, str(path)) for word in words[:count]]))
    return rows


def _undistorted(path: Path) -> Pinhole:
    """Return the camera of lines 'Pinhole fx fy cx cy 0 0 0 0' and 'width height'."""
    rows = [row.split() for row in read_rows(path)]
    if len(rows) < 2 or rows[0][:1] != ["Pinhole"] or len(rows[0]) < 5 or len(rows[1]) != 2:
        raise ValueError(f"{path}: expected 'Pinhole fx fy cx cy ...' and 'width height', found others")
    fx, fy, cx, cy = (number(word, str(path)) for word in rows[0][1:5])
    width, height = (number(word, str(path)) for word in rows[1])
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
    T_munich_earth = SE3.from_parts(*place_on_earth(*MUNICH)).inverse()
    T_map_visual = T_munich_earth @ needed["transform_e_gpsw"] @ needed["transform_w_gpsw"].inverse()
    T_map_slam = T_map_visual @ needed["transform_S_AS"]
    stamps, poses, path = [], [], folder / "GNSSPoses.txt"
    for stamp, (*row, scale) in _stamped_rows(path, 8):
        pose = pose_of_row(np.array(row), path)
        poses.append(T_map_slam @ SE3.from_parts(pose.rotation, scale * pose.translation))
        stamps.append(stamp)
    return trajectory(stamps, poses, path)
