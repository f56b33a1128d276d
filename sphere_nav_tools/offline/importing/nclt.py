"""NCLT, a robot on a campus in 27 sessions: six cameras of a Ladybug3, the clouds of its LiDAR, its truth.

Images come as they were taken, on their side (the poses of the cameras say so), and are undistorted here by the tables
of the set, as its lenses are told by nothing else.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import PointCloud2

from sphere_nav.geometry import SE3, Pinhole, Rig, RigCamera
from sphere_nav.geometry.arrays import Array, Bytes, Floats
from sphere_nav.geometry.files.rig_file import write_rig
from sphere_nav.geometry.files.untrusted import LIMITS, MAX_TABLE_BYTES, read_bytes
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.ros.conversions.clouds import cloud_to_message
from sphere_nav_tools.offline.constants import MAX_POSE_GAP_NS
from sphere_nav_tools.offline.importing.files import read_image, read_numbers, require_folder, trajectory
from sphere_nav_tools.offline.importing.recording import (
    RIG_FRAME,
    Pictures,
    Recording,
    camera_recording,
    of_folder,
    rig_views,
    with_truth,
)

CAMERAS = ("Cam5", "Cam4", "Cam3", "Cam2", "Cam1", "Cam0")  # that which looks ahead first, that which looks up last
# What the set's own projection of its clouds into its images has: x, y, z in m; roll, pitch, heading in deg
BODY_LADYBUG = np.array([0.035, 0.002, -1.23, -179.93, -0.23, 0.50])
T_BASE_BODY = SE3.from_parts(np.diag([1.0, -1.0, -1.0]), np.zeros(3))  # its body, and its world, have z down
POINT = np.dtype([("place", "<u2", 3), ("intensity", "u1"), ("laser", "u1")])  # of a file of velodyne_sync
MAX_BYTES = 16 * MAX_TABLE_BYTES  # 2 million lines of a table of undistortion
BORDER_PX = 15  # of the mask: what the table reaches, less the blur of the edge


Lens = tuple[Floats, Floats]  # (H, W), (H, W): column and row in the image of each pixel that a pinhole sees


def read_undistorted(lens: Lens, path: Path) -> Bytes:
    """Return an image (H, W) grey or (H, W, 3) BGR; what the lens does not see is 0."""
    return np.asarray(cv2.remap(read_image(path), *lens, cv2.INTER_LINEAR), np.uint8)


def open_nclt(folder: Path) -> Recording:
    """Open a session: lb3/CamN/<stamp in us>.tiff, velodyne_sync, groundtruth_*.csv; calibration in it or beside it."""
    images, parts = require_folder(require_folder(folder) / "lb3"), []
    cameras, lenses = dict[str, Pictures](), dict[str, Lens]()
    for name in (name for name in CAMERAS if (images / name).is_dir()):
        number = name.removeprefix("Cam")
        K = read_numbers(_calibration(folder, f"K_cam{number}.csv"), 3, 3)
        pose = read_numbers(_calibration(folder, f"x_lb3_c{number}.csv"), 6, 1)[0]
        lenses[name.lower()] = maps = read_undistortion(_calibration(folder, f"U2D_{name}_1616X1232.txt"))
        cameras[name.lower()] = of_folder(images / name, partial(read_undistorted, maps), is_stamped=True)
        height, width = maps[0].shape
        lens = Pinhole(width, height, K[0, 0], K[1, 1], K[0, 2], K[1, 2])
        T_base_camera = T_BASE_BODY @ pose_of(BODY_LADYBUG, degrees=True) @ pose_of(pose, degrees=True)
        parts.append(RigCamera(name.lower(), lens, T_base_camera))
    if not parts:
        raise ValueError(f"{images}: expected folders Cam0 to Cam5, found none")
    path, rig = _find(folder, f"groundtruth_{folder.resolve().name}.csv"), Rig(tuple(parts))
    seen = camera_recording(rig_views(rig, cameras), link=RIG_FRAME)
    truth = None if path is None else read_ground_truth(path)
    seen = with_truth(seen, "groundtruth_*.csv", truth, MAX_POSE_GAP_NS, SE3.identity())
    instants = []
    for instant in seen.instants:
        cloud = folder / "velodyne_sync" / f"{instant.stamp_ns // 1000}.bin"
        others = {"points": partial(_read_points, cloud, instant.stamp_ns)} if cloud.is_file() else {}
        instants.append(replace(instant, others=others))
    return replace(seen, instants=instants, is_truth_of_base=True, write_beside=partial(_write_rig, rig, lenses))


def _read_points(path: Path, stamp: int) -> PointCloud2:
    """Return the points of a file of velodyne_sync, which are in the frame of the robot's body, z down."""
    data = read_bytes(path, "cloud of NCLT", LIMITS["cloud"])
    if len(data) % POINT.itemsize:
        raise ValueError(f"{path}: expected points of {POINT.itemsize} bytes, found {len(data)} bytes")
    points = np.frombuffer(data, POINT)["place"] * 0.005 - 100.0  # m
    return cloud_to_message(T_BASE_BODY.apply(points), stamp, RIG_FRAME)


def _write_rig(rig: Rig, lenses: dict[str, Lens], folder: Path) -> None:
    """Write rig.yaml, and beside it masks of what the undistorted images show."""
    parts = []
    for part in rig.cameras:
        mask, lens = folder / f"mask_{part.name}.png", lenses[part.name]
        seen = cv2.remap(np.full(lens[0].shape, 255, np.uint8), *lens, cv2.INTER_NEAREST)
        cv2.imwrite(str(mask), cv2.erode(seen, np.ones((2 * BORDER_PX + 1, 2 * BORDER_PX + 1), np.uint8)))
        parts.append(RigCamera(part.name, part.camera, part.T_rig_camera, str(mask), "ladybug"))
    write_rig(folder / "rig.yaml", Rig(tuple(parts), "nclt"))


def pose_of(rows: Array, *, degrees: bool = False) -> SE3:
    """Return the poses of (..., 6): x, y, z (m), roll, pitch, heading; R = Rz(heading) Ry(pitch) Rx(roll)."""
    return SE3.from_parts(Rotation.from_euler("xyz", rows[..., 3:], degrees).as_matrix(), rows[..., :3])


def read_undistortion(path: Path) -> Lens:
    """Return the column and row (H, W) in the image of each pixel of the undistorted one.

    A table of lines 'row column row_in_image column_in_image', every pixel once, in the order of an image.
    """
    table = read_numbers(path, 4, skip=1, max_bytes=MAX_BYTES)
    height, width = (int(value) + 1 for value in table[:, :2].max(axis=0))
    if height * width != len(table) or not np.array_equal(np.argwhere(np.ones((height, width))), table[:, :2]):
        raise ValueError(
            f"{path}: expected a line for each pixel, row by row, found {len(table)} lines in another order"
        )
    rows, columns = (np.ascontiguousarray(table[:, at].reshape(height, width), np.float32) for at in (2, 3))
    return columns, rows


def read_ground_truth(path: Path) -> Trajectory:
    """Return where base_link was, in a world with z up; rows without a pose (NaN) are left out."""
    table = read_numbers(path, 7, may_lack=True, max_bytes=MAX_BYTES)
    table = table[np.isfinite(table).all(axis=1)]
    return trajectory(table[:, 0].astype(np.int64) * 1000, T_BASE_BODY @ pose_of(table[:, 1:]) @ T_BASE_BODY, path)


def _find(folder: Path, name: str) -> Path | None:
    """Return a file that comes in an archive of its own: in a session, beside it, or a folder down."""
    places = [path for place in (folder, folder.parent) for path in (place / name, *sorted(place.glob(f"*/{name}")))]
    return next((path for path in places if path.is_file()), None)


def _calibration(folder: Path, name: str) -> Path:
    if (found := _find(folder, name)) is None:
        raise ValueError(f"{folder}: expected {name} of the calibration in it or beside it, found none")
    return found
