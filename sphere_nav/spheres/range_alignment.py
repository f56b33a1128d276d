"""Ranges against ranges: two spheres, or a sphere and a depth image, aligned by geometry alone, which knows no light.

Points of one are projected into the other and moved along the normals of the surfaces they fall on, coarse to
fine, with robust weights. What both ways agree on, over surfaces that hold all six directions, is a motion.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sphere_nav.estimation.kernels import SIGMA_OF_MAD
from sphere_nav.estimation.least_squares import HUBER, huber_weights, inverse_and_condition, weighted_step
from sphere_nav.geometry import SE3, Camera
from sphere_nav.geometry.arrays import Array, Flags, Floats, Integers
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.geometry.cameras.spherical import level_cameras
from sphere_nav.spheres.coarse import coarse_sphere, nearest_surface
from sphere_nav.spheres.constants import (
    EDGE_SHARE,
    MAX_GAP,
    MAX_GAP_SHARE,
    MAX_NORMAL_ANGLE,
    MAX_RANGE_SIGMA,
    MIN_COARSE_AGREEMENT,
    MIN_COARSE_SIDE,
    MIN_FACING_SHARE,
    MIN_RANGE_AGREEMENT,
    MIN_RANGE_OVERLAP,
    MIN_RANGE_POINTS,
    MIN_RANGE_STEP,
    NUM_RANGE_POINTS,
    RANGE_EDGE_FLOOR,
    RANGE_GATES,
    RANGE_NOISE,
    RANGE_STEPS,
    RANGE_TURN_SHARE,
)
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, Sphere, check_depth


@dataclass(frozen=True, eq=False)
class DepthImage:
    """Depth (H, W) in m along the optical axis, NaN or 0 where there is none; its camera beside that of an image."""

    depth_m: NDArray[np.floating]
    camera: Camera
    T_image_depth: SE3


@dataclass(frozen=True, eq=False)
class RangeImage:
    """Coarse ranges along rays (H, W): flat points (H W, 3) in m and normals (H W, 3), NaN where not known."""

    camera: Camera
    T_camera_body: SE3  # body axes (x ahead) in those of the camera
    range_m: Floats
    points: Array
    normals: Array
    rows: Integers  # of flat points with normals

    @staticmethod
    def from_sphere(sphere: Sphere) -> RangeImage:
        """Return what alignment needs of a sphere."""
        small = coarse_sphere(sphere)
        return _prepare(small.camera, small.range_m, SE3.identity())

    @staticmethod
    def from_depth(depth: DepthImage) -> RangeImage:
        """Return what alignment needs of a depth image; ValueError for one that is not of its camera's size."""
        depth_m = depth.depth_m
        check_depth(depth_m, depth.camera)
        cameras = level_cameras(depth.camera, MIN_COARSE_SIDE)
        camera, factor = cameras[-1], 2 ** (len(cameras) - 1)
        used = depth_m[: camera.height * factor, : camera.width * factor].astype(np.float32)
        small = nearest_surface(np.where(used > 0.0, used, np.float32(np.nan)), factor)
        with np.errstate(divide="ignore", invalid="ignore"):
            return _prepare(camera, small / pixel_rays(camera)[..., 2], T_BODY_OPTICAL.inverse())


@dataclass(frozen=True, eq=False)
class RangeFit:
    """T_a_b by the surfaces of `a`, its covariance (6, 6), and what speaks for it.

    A range camera that bends space errs by the turn between two views: that is in the covariance, too.
    overlap: share of the points of `b` that fall on known ranges of `a`; agreement: share of these that lie there, of
    the surfaces that agree least.
    sigma_m: the largest standard deviation of the position, also that of the attitude by the range; without that.
    """

    T_a_b: SE3
    covariance: Array
    overlap: float
    agreement: float
    sigma_m: float

    @property
    def likeness(self) -> float:
        """Share of the points of `b` that lie on surfaces of `a`."""
        return self.overlap * self.agreement

    @property
    def is_good(self) -> bool:
        """Whether this way alone could be true."""
        is_seen = self.overlap >= MIN_RANGE_OVERLAP and self.agreement >= MIN_RANGE_AGREEMENT
        return is_seen and self.sigma_m <= MAX_RANGE_SIGMA


def _prepare(camera: Camera, range_m: NDArray[np.floating], T_camera_body: SE3) -> RangeImage:
    """Return the image of ranges (H, W)."""
    known = np.where(np.isfinite(range_m), range_m, np.nan).astype(np.float32)
    points = pixel_rays(camera) * known[..., None]
    normals = find_normals(points, known, is_whole=camera.is_whole)
    rows = np.flatnonzero(np.isfinite(normals[..., 0]))
    flat = points.reshape(-1, 3), normals.reshape(-1, 3), rows
    return RangeImage(camera, T_camera_body, known, *flat)


def find_normals(points: Array, range_m: Floats, *, is_whole: bool) -> Array:
    """Return unit normals (H, W, 3) towards the sphere's center, NaN at edges of surfaces."""
    around = np.pad(points, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
    if is_whole:
        around[:, 0], around[:, -1] = around[:, -2], around[:, 1]
    left, right, above, below = around[1:-1, :-2], around[1:-1, 2:], around[:-2, 1:-1], around[2:, 1:-1]
    normals = np.cross(right - left, below - above)
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        normals = normals / length
        normals = np.where(np.sum(normals * points, axis=-1, keepdims=True) > 0.0, -normals, normals)
        steep = np.abs(np.sum(normals * points, axis=-1)) < np.cos(MAX_NORMAL_ANGLE) * range_m
    normals[steep | np.isnan(range_m)] = np.nan
    return normals


def choose_points(a: RangeImage, b: RangeImage, T_a_b: SE3) -> Integers:
    """Return rows of points of `b`, evenly spread; of one all around only those that `a`, which is not, looks at."""
    rows = b.rows
    if b.camera.is_whole and not a.camera.is_whole:
        rows = rows[a.camera.project(T_a_b.apply(b.points[rows]))[1]]
    return rows[:: max(1, len(rows) // NUM_RANGE_POINTS)]


def align_ranges(a: RangeImage, b: RangeImage, T_a_b: SE3) -> RangeFit | None:
    """Return T_a_b from a first guess; None where too little is seen in common on the way."""
    chosen = choose_points(a, b, T_a_b)
    for gate, step in RANGE_GATES:
        points, normals = b.points[chosen[::step]], b.normals[chosen[::step]]
        for _ in range(RANGE_STEPS):
            system = _linearize(a, points, normals, T_a_b, gate)
            if system is None:
                return None
            J, residual, weight = system[:3]
            xi = weighted_step(J, residual, weight)
            T_a_b = T_a_b @ SE3.exp(xi)
            if system[4] < MIN_COARSE_AGREEMENT:
                return None
            if np.linalg.norm(xi) < MIN_RANGE_STEP:
                break
    return assess_ranges(a, b, T_a_b)


def assess_ranges(a: RangeImage, b: RangeImage, T_a_b: SE3) -> RangeFit | None:
    """Return how well ranges fit at a motion, without moving it; None where too little is seen in common."""
    chosen = choose_points(a, b, T_a_b)
    points, normals = b.points[chosen], b.normals[chosen]
    system = _linearize(a, points, normals, T_a_b, RANGE_GATES[-1][0])
    if system is None:
        return None
    J, _, weight, overlap, agreement = system
    covariance, _ = inverse_and_condition((weight[:, None] * J).T @ J)
    if not np.all(np.isfinite(covariance)):
        return None
    typical_m = float(np.median(np.linalg.norm(points, axis=1)))
    variance = max(
        np.linalg.eigvalsh(covariance[:3, :3])[-1], np.linalg.eigvalsh(covariance[3:, 3:])[-1] * typical_m**2
    )
    has_turned = not (a.camera.is_whole or b.camera.is_whole)
    turn_rad = float(a.T_camera_body.distance(T_a_b @ b.T_camera_body)[1]) if has_turned else 0.0
    bend = RANGE_TURN_SHARE * turn_rad * np.repeat([typical_m, 1.0], 3)
    return RangeFit(T_a_b, covariance + np.diag(bend**2), overlap, agreement, float(np.sqrt(variance)))


def measure_motion_by_ranges(a: RangeImage, b: RangeImage, T_a_b: SE3) -> RangeFit | None:
    """Return what both ways agree on, each from the first guess; None unless both are good."""
    ways = fit_both_ways(a, b, T_a_b)
    return ways and reconcile(*ways)


def fit_both_ways(a: RangeImage, b: RangeImage, T_a_b: SE3) -> tuple[RangeFit, RangeFit] | None:
    """Return T_a_b by the surfaces of `a` and T_b_a by those of `b`, each from the first guess, where both are good.

    That both are speaks for one place, however far apart they are: along a street ranges hold little.
    """
    forward = align_ranges(a, b, T_a_b)
    if forward is None or not forward.is_good:
        return None
    back = align_ranges(b, a, T_a_b.inverse())
    return (forward, back) if back is not None and back.is_good else None


def reconcile(forward: RangeFit, back: RangeFit) -> RangeFit | None:
    """Return the motion T_a_b between both ways, with what they are apart in its covariance; None: too much."""
    if is_apart(forward.T_a_b, back.T_a_b):
        return None
    T_a_b, covariance = meet(forward.T_a_b, back.T_a_b, forward.covariance, RANGE_EDGE_FLOOR)
    overlap, agreement = min(forward.overlap, back.overlap), min(forward.agreement, back.agreement)
    return replace(forward, T_a_b=T_a_b, covariance=covariance, overlap=overlap, agreement=agreement)


def is_apart(T_a_b: SE3, T_b_a: SE3) -> bool:
    """Say whether A -> B composed with B -> A is too far from nothing for both to be one motion."""
    gap = (T_b_a @ T_a_b).log()
    limit_m = MAX_GAP[0] + MAX_GAP_SHARE * float(np.linalg.norm(T_a_b.translation))
    return bool(np.linalg.norm(gap[:3]) > limit_m or np.linalg.norm(gap[3:]) > MAX_GAP[1])


def meet(T_a_b: SE3, T_b_a: SE3, covariance: Array, floor: tuple[float, float]) -> tuple[SE3, Array]:
    """Return T_a_b between both ways, and its covariance: of the fits, of what both share, of how far they are apart.

    floor: m, rad that both share, whatever the length of the motion.
    """
    gap = (T_b_a @ T_a_b).log()  # axes of B
    shared = np.repeat([floor[0] + EDGE_SHARE * float(np.linalg.norm(T_a_b.translation)), floor[1]], 3) ** 2
    apart = np.repeat([np.sum(gap[:3] ** 2) / 12, np.sum(gap[3:] ** 2) / 12], 3)
    return T_a_b @ SE3.exp(-0.5 * gap), covariance + np.diag(shared + apart)


def _linearize(
    a: RangeImage, points: Array, normals: Array, T_a_b: SE3, gate: float
) -> tuple[Array, Array, Array, float, float] | None:
    """Return J (M, 6), residuals (M,) in m and weights (M,) of point to plane, overlap and agreement.

    Of xi in T_a_b exp(xi): n (R v + R (omega x p)) = (R^T n) v + (p x R^T n) omega.
    """
    moved = T_a_b.apply(points)
    pixels, is_visible = a.camera.project(moved)
    column = np.rint(np.nan_to_num(pixels[:, 0])).astype(np.int64)
    row = np.rint(np.nan_to_num(pixels[:, 1])).astype(np.int64)
    column = column % a.camera.width if a.camera.is_whole else np.clip(column, 0, a.camera.width - 1)
    flat = np.clip(row, 0, a.camera.height - 1) * a.camera.width + column
    ranges = np.linalg.norm(moved, axis=1)
    known = a.range_m.ravel()[flat]
    with np.errstate(invalid="ignore"):
        is_seen = is_visible & np.isfinite(known) & np.isfinite(a.normals[flat, 0])
        ahead = np.abs(ranges - known) <= gate * known
        turned = normals @ T_a_b.rotation.T
        is_alike = ahead & (np.sum(turned * a.normals[flat], axis=1) > np.cos(MAX_NORMAL_ANGLE))
    used = np.flatnonzero(is_seen & is_alike)
    overlap = float(np.count_nonzero(is_seen)) / max(len(points), 1)
    if overlap < MIN_RANGE_OVERLAP or len(used) < MIN_RANGE_POINTS:
        return None
    normal = a.normals[flat[used]]
    residual = np.sum(normal * (moved[used] - a.points[flat[used]]), axis=1)
    n_b = normal @ T_a_b.rotation
    J = np.concatenate([n_b, np.cross(points[used], n_b)], axis=1)
    floor = RANGE_NOISE[0] + RANGE_NOISE[1] * known[used]
    sigma = max(1.0, SIGMA_OF_MAD * float(np.median(np.abs(residual / floor)))) * floor
    weight = huber_weights(np.abs(residual) / sigma, HUBER) / sigma**2
    return J, residual, weight, overlap, _agree(normals, is_seen, is_seen & is_alike)


def _agree(normals: Array, is_seen: Flags, is_alike: Flags) -> float:
    """Return the share of the points seen that lie where they should, of the surfaces that agree least.

    Surfaces face along one of three axes; a road fills half of a sphere, and roads are alike everywhere.
    """
    axis = np.argmax(np.abs(normals), axis=1)
    seen, alike = (np.bincount(axis[chosen], minlength=3) for chosen in (is_seen, is_alike))
    counted = seen >= MIN_FACING_SHARE * seen.sum()
    return float(np.min(alike[counted] / seen[counted]))
