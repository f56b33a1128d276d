"""Poses that took a rolling shutter for a global one, put right by the depth of the same images.

Structure from motion gives a camera the pose by which its pixels fit best as if they had been read at once; COLMAP has
no other. How far that is from the pose of the middle row follows without any alignment of ours: points by the depth,
projected row by row under the motion that the poses themselves tell, and the pose that explains these pixels at once.
To first order: the points of the reconstruction are taken as right, so about half of what a whole bundle adjustment
would change is changed.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import SE3, Camera
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.camera import pixel_grid
from sphere_nav.geometry.cameras.rolling_shutter import project_rolling
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.ros.bags import BagReader
from sphere_nav.ros.conversions import camera_from_info, depth_to_meters, stamp_ns
from sphere_nav.spheres.sphere import T_BODY_OPTICAL

STEP = 12  # px between points
MIN_POINTS = 50


def straighten(bag: Path, truth: Trajectory, readout_s: float) -> Trajectory:
    """Return the poses of the middle rows of a bag's images, of those with a true pose by a global shutter."""
    optical = SE3((truth.T_map_body @ T_BODY_OPTICAL).matrix)
    number = {int(stamp): index for index, stamp in enumerate(truth.stamps_ns)}
    straight = truth.T_map_body.matrix.copy()
    with BagReader(bag) as reader:
        camera: Camera = camera_from_info(next(reader.messages(["/camera_info"])).message)
        rays = camera.unproject(pixel_grid(camera)[::STEP, ::STEP])
        for _, _, message in reader.messages(["/depth/image_raw"]):
            index = number.get(stamp_ns(message))
            if index is None:
                continue
            depth = depth_to_meters(message)[::STEP, ::STEP]
            points = (rays / rays[..., 2:] * depth[..., None])[np.isfinite(depth)]
            twist = twist_of(truth.stamps_ns, optical, index, readout_s)
            T_middle_fit = fit_at_once(camera, points, twist)
            straight[index] = (optical[index] @ T_middle_fit.inverse() @ T_BODY_OPTICAL.inverse()).matrix
    return Trajectory(truth.stamps_ns, SE3(straight))


def twist_of(stamps_ns: NDArray[np.int64], poses: SE3, index: int, readout_s: float) -> Array:
    """Return the motion (6,) within a readout, in the frame of the pose, by the poses before and after."""
    before, after = max(index - 1, 0), min(index + 1, len(stamps_ns) - 1)
    seconds = max(float(stamps_ns[after] - stamps_ns[before]) * 1e-9, 1e-9)
    return np.asarray((poses[before].inverse() @ poses[after]).log() * (readout_s / seconds), np.float64)


def fit_at_once(camera: Camera, points: Array, twist: Array) -> SE3:
    """Return T_middle_fit: where a global shutter would see points (N, 3), of the middle row, as a rolling one does.

    Identity where too few of the points are seen.
    """
    pixels, is_seen = project_rolling(camera, points, twist)
    if np.count_nonzero(is_seen) < MIN_POINTS:
        return SE3.identity()
    rays = camera.unproject(pixels[is_seen])
    turn, moved = cv2.solvePnPRefineLM(
        points[is_seen], rays[:, :2] / rays[:, 2:], np.eye(3), None, *np.zeros((2, 3, 1))
    )
    return SE3.from_parts(cv2.Rodrigues(turn)[0], moved.ravel()).inverse()
