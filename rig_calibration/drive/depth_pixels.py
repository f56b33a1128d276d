"""The points of a depth camera that a pair of images is compared at, with the planes around them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rig_calibration.constants import (
    CELL_PX,
    FLAT,
    HIDDEN,
    MIN_COSINE,
    MIN_MEASURED,
    NUM_DEPTH_LEVELS,
    NUM_POINTS,
    PLANE_REACH,
    PLANE_STEP_PX,
)
from rig_calibration.drive.depth_pair import DepthFrame, DepthPair
from sphere_nav.geometry import SE3, Camera
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.photometric import build_pyramid
from sphere_nav.photometric.params import PyramidParams


def make_frame(
    gray: NDArray[np.uint8], depth_m: NDArray[np.floating], camera: Camera, depth_camera: Camera, twist: Array
) -> DepthFrame:
    """Return a frame of an image (H, W) and depth (H', W') along z in m, NaN or <= 0 unknown."""
    pyramid = build_pyramid(gray, camera, PyramidParams(num_levels=NUM_DEPTH_LEVELS))
    points, normals = sample_planes(depth_m, depth_camera)
    return DepthFrame(tuple(level.image.astype(np.float32) for level in pyramid.levels), points, normals, twist)


def sample_planes(depth_m: NDArray[np.floating], camera: Camera) -> tuple[Array, Array]:
    """Return points (N, 3) m on a grid where depth (H, W) is flat, and the unit normals (N, 3) there.

    On a plane the inverse of depth is linear in the rays with z = 1: its three coefficients are the normal.
    """
    step = max(1, round(np.sqrt(depth_m.size / NUM_POINTS)))
    border = PLANE_REACH * PLANE_STEP_PX
    v, u = np.mgrid[border : camera.height - border : step, border : camera.width - border : step].reshape(2, -1)
    reach = np.arange(-PLANE_REACH, PLANE_REACH + 1) * PLANE_STEP_PX
    rows, columns = v[:, None, None] + reach[:, None], u[:, None, None] + reach  # (N, 7, 7) by broadcasting
    depth = np.asarray(depth_m, np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = np.where((depth > 0) & np.isfinite(depth), 1.0 / depth, 0.0)
    rays = pixel_rays(camera)
    rays = np.nan_to_num(rays / rays[..., 2:])
    known = inverse[rows, columns].reshape(len(v), -1)
    around = rays[rows, columns].reshape(len(v), -1, 3) * (known > 0)[..., None]
    count = (known > 0).sum(axis=1)
    good = (inverse[v, u] > 0) & (count >= MIN_MEASURED * known.shape[1])
    known, around, ray, count = known[good], around[good], rays[v, u][good], count[good]
    turned = np.swapaxes(around, 1, 2)
    plane = np.linalg.solve(turned @ around + 1e-12 * np.eye(3), turned @ known[..., None])[..., 0]
    off = np.einsum("nki,ni->nk", around, plane) - known
    at = np.einsum("ni,ni->n", plane, ray)  # inverse depth
    size = np.linalg.norm(plane, axis=1)
    flat = np.sqrt((off**2).sum(axis=1) / count) < FLAT * at
    facing = at > MIN_COSINE * size * np.linalg.norm(ray, axis=1)
    kept = flat & facing
    # the depth itself: the plane cuts concave edges, which would bring depth nearer
    return ray[kept] / inverse[v, u][good][kept, None], plane[kept] / size[kept, None]


def without_hidden(pair: DepthPair, camera: Camera, T_image_depth: SE3) -> DepthPair:
    """Return the pair without points that others hide from one of the images."""
    T = pair.T_second_first @ T_image_depth, pair.T_second_first.inverse() @ T_image_depth
    frames = []
    for frame, T_other_depth in zip((pair.first, pair.second), T, strict=True):
        is_seen = _in_front(T_image_depth.apply(frame.points_depth), camera)
        is_seen &= _in_front(T_other_depth.apply(frame.points_depth), camera)
        points, normals = frame.points_depth[is_seen], frame.normals_depth[is_seen]
        frames.append(replace(frame, points_depth=points, normals_depth=normals))
    return replace(pair, first=frames[0], second=frames[1])


def _in_front(points: Array, camera: Camera) -> NDArray[np.bool_]:
    """Say which points (N, 3) nothing hides, as far as the others show."""
    pixels, is_inside = camera.project(points)
    cells = (np.nan_to_num(pixels, nan=-1.0) // CELL_PX).astype(np.int64)
    columns = camera.width // CELL_PX + 1
    index = np.where(is_inside, cells[:, 1] * columns + cells[:, 0], -1)
    distance = np.linalg.norm(points, axis=1)
    nearest = np.full(columns * (camera.height // CELL_PX + 1), np.inf)
    np.minimum.at(nearest, index[is_inside], distance[is_inside])
    return is_inside & (distance < HIDDEN * nearest[index])
