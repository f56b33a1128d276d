"""Two images of an RGB-D camera: residuals, and their derivatives by the pose of its depth camera, motion and light.

The depth camera gives patches: points with the plane around them. If it sits elsewhere, the plane moves, so that
another range belongs to the pixel that shows the point, and the other image shows that pixel elsewhere along its
epipolar line. Nothing is told where there is no parallax, and a shift of depth along a surface is told by no image.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig_calibration.drive.drive_image import ImageState, inner, sample_with_gradient
from sphere_nav.geometry import SE3, Camera
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.rolling_shutter import project_rolling, row_share

Plane = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class DepthFrame:
    """Images (H, W) float32 from full size to coarse, points (N, 3) m and normals (N, 3) of the depth camera, motion.

    twist (6,) is the motion (v, omega) of the image's camera while its rows are read, zero for a global shutter; depth
    is read row by row with the image.
    """

    levels: tuple[Plane, ...]
    points_depth: Array
    normals_depth: Array
    twist: Array


@dataclass(frozen=True, eq=False)
class DepthPair:
    """Two frames of one camera and the motion between its images."""

    first: DepthFrame
    second: DepthFrame
    T_second_first: SE3


@dataclass(frozen=True, eq=False)
class _Seen:
    """Points of one frame: grey levels (N,) of their image and of the other one, derivatives (N, 6) of the other."""

    own: Array
    other: Array
    by_depth: Array  # the pose of the depth camera
    by_camera: Array  # the motion of the points' own camera
    by_other: Array  # of the points in the axes of the other camera


def differentiate_pair(
    pair: DepthPair, state: ImageState, T_image_depth: SE3, camera: Camera, level: int
) -> tuple[Array, Array]:
    """Return residuals (N,), second - gain * first - bias, of the points of both frames and derivatives (N, 14).

    `camera` is that of the level. The steps are exp(step) T_image_depth and T_second_first exp(step).
    """
    T = state.pose
    ahead = _see(pair.first, pair.second, T, T_image_depth, camera, level)
    back = _see(pair.second, pair.first, T.inverse(), T_image_depth, camera, level)
    gain = state.gain
    residual = np.concatenate([ahead.other - gain * ahead.own, back.own - gain * back.other]) - state.bias
    by_depth = np.concatenate([ahead.by_depth, -gain * back.by_depth])
    by_motion = np.concatenate([ahead.by_camera, gain * back.by_other])  # the second's inverse moves back
    by_gain = -np.concatenate([ahead.own, back.other])[:, None]
    return residual, np.concatenate([by_depth, by_motion, by_gain, -np.ones_like(by_gain)], axis=1)


def _see(
    frame: DepthFrame, other: DepthFrame, T_other_frame: SE3, T_image_depth: SE3, camera: Camera, level: int
) -> _Seen:
    points, normals = T_image_depth.apply(frame.points_depth), frame.normals_depth @ T_image_depth.rotation.T
    pixels, _ = camera.project(points)
    turn, there, pixels_there = _move(points, pixels, frame.twist, other.twist, T_other_frame, camera)
    seen = inner(pixels, camera) & inner(pixels_there, camera)
    points, normals, there, turn = points[seen], normals[seen], there[seen], turn[seen]
    own, _ = sample_with_gradient(frame.levels[level], pixels[seen])
    gray, gradient = sample_with_gradient(other.levels[level], pixels_there[seen])
    by_there = np.einsum("ni,nij->nj", gradient, camera.J_project(there))
    by_point = np.einsum("nj,njk->nk", by_there, turn)
    # the point slides along its own ray to where its plane moves
    share = np.einsum("ni,ni->n", by_point, points) / np.einsum("ni,ni->n", normals, points)
    by_plane = share[:, None] * normals
    return _Seen(own, gray, *(_turn_too(J, p) for J, p in ((by_plane, points), (by_point, points), (by_there, there))))


def _move(
    points: Array, pixels: Array, twist: Array, twist_there: Array, T_other_frame: SE3, camera: Camera
) -> tuple[Array, Array, Array]:
    """Return rotations (N, 3, 3), points (N, 3) and pixels (N, 2) in the other image, each as its row is read."""
    if not np.any(twist) and not np.any(twist_there):
        there = T_other_frame.apply(points)
        return np.broadcast_to(T_other_frame.rotation, (len(points), 3, 3)), there, camera.project(there)[0]
    to_middle = SE3.exp(np.nan_to_num(row_share(pixels[:, 1], camera.height))[:, None] * twist)
    middle = T_other_frame.apply(np.einsum("nij,nj->ni", to_middle.rotation, points) + to_middle.translation)
    pixels_there, _ = project_rolling(camera, middle, twist_there)
    from_middle = SE3.exp(np.nan_to_num(row_share(pixels_there[:, 1], camera.height))[:, None] * -twist_there)
    there = np.einsum("nij,nj->ni", from_middle.rotation, middle) + from_middle.translation
    return from_middle.rotation @ T_other_frame.rotation @ to_middle.rotation, there, pixels_there


def _turn_too(by_point: Array, points: Array) -> Array:
    """Return derivatives (N, 6) by (v, omega) of points p that move with v + omega x p, from those (N, 3) by p."""
    return np.concatenate([by_point, np.cross(points, by_point)], axis=1)
