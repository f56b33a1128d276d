"""What a rig's own images say about its calibration: small corrections, so that epipolar lines are columns indeed.

Features that two cameras see must lie in one plane with both centres. The rotations, focal lengths and principal points
that make them do so best, and differ least from the rig file by the file's own uncertainty, are found by robust least
squares (M15 section 4.3.1, step 3). Centres stay: at their baselines the images say next to nothing about them.

A camera has six values: turn (3) in rad, logarithm of the focal length, centre (2) in shares of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.spatial import cKDTree

from sphere_mapping.acquisition.constants import (
    CLOUD_REACH_DEG,
    FEATURE_WIDTH,
    FROM_BORDER_DEG,
    LENS_STD,
    MAX_PARALLAX_DEG,
    MAX_RATIO,
    MIN_PAIR_MATCHES,
    NEAR_EPIPOLE,
    POLE_DEG,
    RANGE_SHARE,
    RECTIFY_SCALES_DEG,
    RECTIFY_SIFT,
    TURN_STD,
    VERY_FAR_M,
)
from sphere_mapping.acquisition.stitching.views import RigView
from sphere_nav.geometry import SE3, Rig, RigCamera, Spherical
from sphere_nav.geometry.arrays import Array, Bytes, Flags, Floats, Integers
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.spheres.appearance.pose import choose_each_other

NUM_VALUES = 6  # of a camera


@dataclass(frozen=True, eq=False)
class Matches:
    """Pixels (N, 2) of two cameras that show the same; how far it is from the first (N,) m, NaN where unknown."""

    first: str
    second: str
    pixels_first: Array
    pixels_second: Array
    range_first: Array | None = None


def correct(rig: Rig, values: Array) -> Rig:
    """Return the rig whose cameras are changed by their values (6 N,)."""
    parts = [_change(part, own) for part, own in zip(rig.cameras, values.reshape(-1, NUM_VALUES), strict=True)]
    return replace(rig, cameras=tuple(parts))


def epipolar_errors(rig: Rig, matches: Sequence[Matches]) -> Array:
    """Return the signed angle (M,) in rad of all matches off their epipolar planes; smaller near the baseline."""
    found = [_off_plane(*rays_of(rig, match)) for match in matches]
    return np.nan_to_num(np.concatenate([np.zeros(0), *found]))


def match_angles(rig: Rig, matches: Sequence[Matches], scale: float) -> Array:
    """Return the angles (M,) by the scale, of all matches off their planes and of those with range off their place."""
    ranged = [(match, match.range_first) for match in matches if match.range_first is not None]
    found = [_off_range(range_m, scale, *rays_of(rig, match)) for match, range_m in ranged]
    return np.concatenate([epipolar_errors(rig, matches), np.nan_to_num(np.concatenate([np.zeros(0), *found]))]) / scale


def _off_plane(x: Array, y: Array, along: Array) -> Array:
    """Return the signed angle (N,) of rays y off the planes of rays x and the baseline; smaller near the baseline."""
    normal = np.cross(along / np.linalg.norm(along), x)
    return np.sum(normal * y, axis=1) / np.maximum(np.linalg.norm(normal, axis=1), NEAR_EPIPOLE)


def _off_range(range_m: Array, scale: float, x: Array, y: Array, along: Array) -> Array:
    """Return the angle (N,) of rays y off where on the epipolar line a range (N,) along x puts them.

    Scaled down where the range, known to RANGE_SHARE of it, says less than `scale` about that place.
    """
    seen = x * range_m[:, None] - along
    seen = seen / np.linalg.norm(seen, axis=1, keepdims=True)
    normal = np.cross(along, seen)
    normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    parallax = np.linalg.norm(np.cross(x, seen), axis=1)
    return np.sum(np.cross(normal, seen) * y, axis=1) / np.hypot(1.0, RANGE_SHARE * parallax / scale)


def rays_of(rig: Rig, match: Matches) -> tuple[Array, Array, Array]:
    """Return the rays (N, 3) of both cameras and their baseline (3,) in the frame of the rig."""
    first, second = rig.camera(match.first), rig.camera(match.second)
    x = first.camera.unproject(match.pixels_first) @ first.T_rig_camera.rotation.T
    y = second.camera.unproject(match.pixels_second) @ second.T_rig_camera.rotation.T
    return x, y, second.T_rig_camera.translation - first.T_rig_camera.translation


def _change(part: RigCamera, own: Array) -> RigCamera:
    camera: Any = part.camera  # no spherical one
    fx, fy = (float(value) for value in camera.coefficients[:2])
    lens = {"cx": camera.cx + fx * float(own[4]), "cy": camera.cy + fy * float(own[5])}
    turn = SE3.exp(np.concatenate([np.zeros(3), own[:3]]))
    camera = replace(camera.scaled(float(np.exp(own[3]))), **lens)
    return replace(part, camera=camera, T_rig_camera=part.T_rig_camera @ turn)


@dataclass(frozen=True, eq=False)
class RigCorrection:
    """The corrected rig, and by camera the angle (deg) of its correction.

    before_deg, after_deg: median angle between matches and their epipolar planes.
    """

    rig: Rig
    angle_deg: dict[str, float]
    before_deg: float
    after_deg: float


def matches_of(
    rig_views: Sequence[RigView], images: Mapping[str, Bytes], points_sphere: Array | None = None
) -> list[Matches]:
    """Return the features that pairs of cameras share in the grey images (h, w) of one instant.

    points_sphere (N, 3): a LiDAR's cloud; it tells how far features are.
    """
    views = {rig_view.name: rig_view for rig_view in rig_views}
    whole = Spherical(FEATURE_WIDTH, FEATURE_WIDTH // 2)
    found = {
        rig_view.name: _features(rig_view, images[rig_view.name], whole)
        for rig_view in rig_views
        if rig_view.name in images
    }
    matches = []
    for a, b in combinations(found, 2):
        is_far = found[a][1].astype(np.float32) @ found[b][1].T.astype(np.float32) < np.cos(
            np.radians(MAX_PARALLAX_DEG)
        )
        pairs = pair_descriptors(found[a][2], found[b][2], is_far)
        if pairs.shape[1] >= MIN_PAIR_MATCHES:
            pixels = found[a][0][pairs[0]]
            ranges = None if points_sphere is None else _range_at(pixels, views[a], points_sphere)
            matches.append(Matches(a, b, pixels, found[b][0][pairs[1]], ranges))
    return matches


def rectify(rig: Rig, matches: Sequence[Matches]) -> RigCorrection:
    """Return the rig corrected by matches of one or several instants."""
    names = [part.name for part in rig.cameras]
    values = np.zeros(NUM_VALUES * len(names))
    prior = np.tile([*[TURN_STD] * 3, *LENS_STD], len(names))
    before = epipolar_errors(rig, matches)
    if not matches:
        return RigCorrection(rig, dict.fromkeys(names, 0.0), float("nan"), float("nan"))
    for scale_deg in RECTIFY_SCALES_DEG:
        scale = np.radians(scale_deg)

        def cost(now: Array, scale: float = scale) -> Array:
            return np.concatenate([_soften(match_angles(correct(rig, now), matches, scale)), now / prior])

        values = least_squares(cost, values, method="trf", x_scale=prior, max_nfev=20).x
    better = correct(rig, values)
    after = epipolar_errors(better, matches)
    angles_deg = np.degrees(np.linalg.norm(values.reshape(-1, NUM_VALUES)[:, :3], axis=1))
    medians = [float(np.degrees(np.median(np.abs(errors)))) for errors in (before, after)]
    return RigCorrection(better, dict(zip(names, angles_deg.tolist(), strict=True)), *medians)


def _soften(values: Array) -> Array:
    """Return values (M,) whose squares are Cauchy's loss."""
    return np.copysign(np.sqrt(np.log1p(np.square(values))), values)


def _features(rig_view: RigView, image: Bytes, whole: Spherical) -> tuple[Array, Array, Floats]:
    """Return pixels of the camera, rays of the sphere and descriptors of features, seen from very far."""
    u, v, border = rig_view.project(pixel_rays(whole) * VERY_FAR_M)
    seen = (border > np.radians(FROM_BORDER_DEG)).astype(np.uint8)
    pole = round(whole.height * POLE_DEG / 180.0)
    seen[:pole], seen[whole.height - pole :] = 0, 0
    view = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    points, descriptors = find_features(view, seen, **RECTIFY_SIFT)
    rays = whole.unproject(points)
    pixels, _ = rig_view.camera.project(rig_view.T_sphere_camera.inverse().apply(rays * VERY_FAR_M))
    return pixels, rays, descriptors


def _range_at(pixels: Array, rig_view: RigView, points_sphere: Array) -> Array:
    """Return the range (N,) of the cloud's point seen next to each pixel, NaN where none is near."""
    points = rig_view.T_sphere_camera.inverse().apply(points_sphere)
    at, visible = rig_view.camera.project(points)
    if not visible.any():
        return np.full(len(pixels), np.nan)
    reach = np.radians(CLOUD_REACH_DEG) * rig_view.camera.pixels_per_radian
    distance, nearest = cKDTree(at[visible]).query(pixels, distance_upper_bound=reach)
    ranges = np.append(np.linalg.norm(points[visible], axis=1), np.nan)
    return np.where(np.isfinite(distance), ranges[nearest], np.nan)


def find_features(image: Bytes, mask: Bytes | None = None, **limits: Any) -> tuple[Array, Floats]:
    """Return pixels (N, 2) and SIFT descriptors (N, 128) of a grey image (h, w)."""
    points, descriptors = cv2.SIFT_create(**limits).detectAndCompute(image, mask)
    if descriptors is None:
        return np.zeros((0, 2)), np.zeros((0, 128), np.float32)
    return np.array([point.pt for point in points], np.float64), descriptors


def pair_descriptors(a: Floats, b: Floats, is_far: Flags | None = None) -> Integers:
    """Return indices (2, N) of descriptors (M, 128) that choose each other, clearly, and are not said to be too far."""
    squares = np.sum(a * a, axis=1)[:, None] + np.sum(b * b, axis=1)[None] - 2 * a @ b.T
    squares = np.maximum(squares, 0.0)
    if is_far is not None:
        squares[is_far] = np.inf
    return choose_each_other(squares, MAX_RATIO**2).T
